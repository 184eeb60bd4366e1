// Block scaling of a stage: hold a transform back until its largest part has determined the shift.
//
// The shift is 0, 1 or 2: one bit for each limit that the largest part exceeds. Words appear
// 2^INDEX_BITS + 2 clocks later, together with the shift of their transform and its exponent.
module dechirp_block_scaling #(
    parameter BITS = 16,
    parameter INDEX_BITS = 8,
    parameter EXPONENT_BITS = 5,
    parameter [2*BITS-1:0] LIMITS = 0
) (
    input  wire                     clk,
    input  wire                     rst,
    input  wire                     en,
    input  wire [INDEX_BITS-1:0]    in_index,
    input  wire signed [BITS-1:0]   in_re,
    input  wire signed [BITS-1:0]   in_im,
    input  wire [EXPONENT_BITS-1:0] in_exponent,
    output wire [INDEX_BITS-1:0]    out_index,
    output wire signed [BITS-1:0]   out_re,
    output wire signed [BITS-1:0]   out_im,
    output reg  [1:0]               shift,
    output reg  [EXPONENT_BITS-1:0] exponent
);
    localparam [BITS-1:0] LIMIT_0 = LIMITS[BITS-1:0], LIMIT_1 = LIMITS[2*BITS-1:BITS];
    localparam [INDEX_BITS-1:0] FIRST = 0, LAG = 2;

    wire [BITS-1:0] size_re = in_re[BITS-1] ? -in_re : in_re;
    wire [BITS-1:0] size_im = in_im[BITS-1] ? -in_im : in_im;
    reg  [BITS-1:0] size, largest;
    reg  [EXPONENT_BITS-1:0] exponent_1, exponent_2;
    reg  is_first;  // `size` is that of a first word, `largest` that of the transform before
    wire [1:0] next_shift = {1'b0, largest > LIMIT_0} + {1'b0, largest > LIMIT_1};
    always @(posedge clk) begin
        if (en) begin
            size <= size_re > size_im ? size_re : size_im;
            exponent_1 <= in_exponent;
            exponent_2 <= exponent_1;
            is_first <= in_index == FIRST;
            if (is_first || size > largest) largest <= size;
            if (is_first) begin
                shift <= next_shift;
                exponent <= exponent_2 + {{(EXPONENT_BITS - 2){1'b0}}, next_shift};
            end
        end
    end

    assign out_index = in_index - LAG;
    dechirp_delay_line #(2 * BITS, (1 << INDEX_BITS) + 2) transform (
        clk, rst, en, {in_im, in_re}, {out_im, out_re}
    );
endmodule
