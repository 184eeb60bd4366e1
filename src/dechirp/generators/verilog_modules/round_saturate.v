// Shift a word right by SHIFT + amount bits, round it, and saturate it; combinational.
module dechirp_round_saturate #(
    parameter IN_BITS = 34,
    parameter SHIFT = 15,  // negative: left
    parameter AMOUNT_BITS = 1,
    parameter MAX_AMOUNT = 0,
    parameter OUT_BITS = 16,
    parameter ROUNDING = 0
) (
    input  wire signed [IN_BITS-1:0]  in,
    input  wire [AMOUNT_BITS-1:0]     amount,
    output wire signed [OUT_BITS-1:0] out
);
    localparam LEFT = SHIFT < 0 ? -SHIFT : 0;
    localparam BITS = (IN_BITS + LEFT > OUT_BITS ? IN_BITS + LEFT : OUT_BITS) + 1;
    wire signed [BITS-1:0] floor;
    wire half, beyond;
    dechirp_shift_right #(IN_BITS, SHIFT, AMOUNT_BITS, MAX_AMOUNT, BITS)
        shift (in, amount, floor, half, beyond);
    dechirp_round #(BITS, OUT_BITS, ROUNDING) round (floor, half, beyond, out);
endmodule
