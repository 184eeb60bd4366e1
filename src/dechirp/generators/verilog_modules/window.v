// Multiply a complex sample by a weight, shift by SHIFT + amount, round and saturate: four clocks.
module dechirp_window #(
    parameter IN_BITS = 16,
    parameter WEIGHT_BITS = 16,
    parameter OUT_BITS = 16,
    parameter SHIFT = 14,
    parameter AMOUNT_BITS = 1,
    parameter MAX_AMOUNT = 0,
    parameter ROUNDING = 0
) (
    input  wire                          clk,
    input  wire                          en,
    input  wire signed [IN_BITS-1:0]     in_re,
    input  wire signed [IN_BITS-1:0]     in_im,
    input  wire signed [WEIGHT_BITS-1:0] weight,
    input  wire [AMOUNT_BITS-1:0]        amount,
    output reg  signed [OUT_BITS-1:0]    out_re,
    output reg  signed [OUT_BITS-1:0]    out_im
);
    localparam PRODUCT_BITS = IN_BITS + WEIGHT_BITS;
    reg  signed [PRODUCT_BITS-1:0] product_re, product_im;
    reg  signed [IN_BITS-1:0] re_1, im_1;
    reg  signed [WEIGHT_BITS-1:0] weight_1;
    reg  [AMOUNT_BITS-1:0] amount_1, amount_2;
    localparam LEFT = SHIFT < 0 ? -SHIFT : 0;
    localparam BITS = (PRODUCT_BITS + LEFT > OUT_BITS ? PRODUCT_BITS + LEFT : OUT_BITS) + 1;
    wire signed [BITS-1:0] next_floor_re, next_floor_im;
    wire next_half_re, next_half_im, next_beyond_re, next_beyond_im;
    reg  signed [BITS-1:0] floor_re, floor_im;
    reg  half_re, half_im, beyond_re, beyond_im;
    wire signed [OUT_BITS-1:0] word_re, word_im;

    dechirp_shift_right #(PRODUCT_BITS, SHIFT, AMOUNT_BITS, MAX_AMOUNT, BITS)
        shift_re (product_re, amount_2, next_floor_re, next_half_re, next_beyond_re),
        shift_im (product_im, amount_2, next_floor_im, next_half_im, next_beyond_im);
    dechirp_round #(BITS, OUT_BITS, ROUNDING)
        round_re (floor_re, half_re, beyond_re, word_re),
        round_im (floor_im, half_im, beyond_im, word_im);

    always @(posedge clk) begin
        if (en) begin
            re_1 <= in_re;
            im_1 <= in_im;
            weight_1 <= weight;
            amount_1 <= amount;
            product_re <= re_1 * weight_1;
            product_im <= im_1 * weight_1;
            amount_2 <= amount_1;
            floor_re <= next_floor_re;
            floor_im <= next_floor_im;
            half_re <= next_half_re;
            half_im <= next_half_im;
            beyond_re <= next_beyond_re;
            beyond_im <= next_beyond_im;
            out_re <= word_re;
            out_im <= word_im;
        end
    end
endmodule
