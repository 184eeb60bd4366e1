// Power of a complex word, shifted by SHIFT and two bits for each bit of `alignment`, rounded and
// saturated: six clocks.
module dechirp_power #(
    parameter IN_BITS = 16,
    parameter ALIGNMENT_BITS = 5,
    parameter MAX_ALIGNMENT = 0,
    parameter SHIFT = -16,
    parameter OUT_BITS = 48,
    parameter ROUNDING = 0
) (
    input  wire                      clk,
    input  wire                      en,
    input  wire signed [IN_BITS-1:0] in_re,
    input  wire signed [IN_BITS-1:0] in_im,
    input  wire [ALIGNMENT_BITS-1:0] alignment,
    output reg  [OUT_BITS-1:0]       out
);
    // Squares, and their sum. The first register is there because reading a block RAM takes long.
    reg  signed [IN_BITS-1:0] re_1, im_1;
    reg  [2*IN_BITS-1:0] square_re, square_im;
    reg  [2*IN_BITS:0] squares;
    reg  [ALIGNMENT_BITS-1:0] alignment_1, alignment_2, alignment_3;

    // The alignment takes two clocks: multiples of 8 bits, then 0, 2, 4 or 6 with the fixed shift.
    localparam ALIGNED_BITS = 2 * IN_BITS + 2 + 2 * MAX_ALIGNMENT;
    localparam FINE_SHIFT = SHIFT + 2 * MAX_ALIGNMENT;
    localparam LEFT = FINE_SHIFT < 0 ? -FINE_SHIFT : 0;
    localparam FLOOR_BITS = (ALIGNED_BITS + LEFT > OUT_BITS ? ALIGNED_BITS + LEFT : OUT_BITS + 1) + 1;
    reg  [ALIGNED_BITS-1:0] aligned;
    reg  [1:0] alignment_4;
    wire [FLOOR_BITS-1:0] next_floor;
    wire next_half, next_beyond;
    dechirp_shift_right #(ALIGNED_BITS, FINE_SHIFT, 3, MAX_ALIGNMENT > 0 ? 6 : 0, FLOOR_BITS)
        shift (aligned, {alignment_4, 1'b0}, next_floor, next_half, next_beyond);

    reg  [FLOOR_BITS-1:0] floor;
    reg  half, beyond;
    wire [OUT_BITS:0] rounded;  // not negative
    wire unused_sign = rounded[OUT_BITS];
    dechirp_round #(FLOOR_BITS, OUT_BITS + 1, ROUNDING) round (floor, half, beyond, rounded);

    always @(posedge clk) begin
        if (en) begin
            re_1 <= in_re;
            im_1 <= in_im;
            square_re <= re_1 * re_1;
            square_im <= im_1 * im_1;
            squares <= {1'b0, square_re} + {1'b0, square_im};
            alignment_1 <= alignment;
            alignment_2 <= alignment_1;
            alignment_3 <= alignment_2;
            alignment_4 <= alignment_3[1:0];
            aligned <= {1'b0, squares, {2 * MAX_ALIGNMENT{1'b0}}}
                >> {alignment_3[ALIGNMENT_BITS-1:2], 3'd0};
            floor <= next_floor;
            half <= next_half;
            beyond <= next_beyond;
            out <= rounded[OUT_BITS-1:0];
        end
    end
endmodule
