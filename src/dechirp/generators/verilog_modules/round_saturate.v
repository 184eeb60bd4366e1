// Shift a word right by SHIFT + amount bits, round it, and saturate it; combinational.
//
// A negative SHIFT shifts left. ROUNDING: 0 convergent, 1 half-up, 2 truncate.
module dechirp_round_saturate #(
    parameter IN_BITS = 34,
    parameter SHIFT = 15,
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
    localparam RIGHT = SHIFT > 0 ? SHIFT : 0;
    // Bits behind the point, at least two for the rounding; and before it, one for its carry.
    localparam FRACTION = RIGHT + MAX_AMOUNT + 2;
    localparam WHOLE = (IN_BITS + LEFT > OUT_BITS ? IN_BITS + LEFT : OUT_BITS) + 1;

    wire signed [WHOLE-1:0] extended = {{(WHOLE - IN_BITS){in[IN_BITS-1]}}, in};
    wire signed [WHOLE+FRACTION-1:0] aligned = {extended <<< LEFT, {FRACTION{1'b0}}};
    wire signed [WHOLE+FRACTION-1:0] shifted = (aligned >>> RIGHT) >>> amount;
    wire signed [WHOLE-1:0] floor = shifted[WHOLE+FRACTION-1:FRACTION];
    wire half = shifted[FRACTION-1];
    wire beyond = |shifted[FRACTION-2:0];
    wire increment = half && (ROUNDING == 1 || (ROUNDING == 0 && (beyond || floor[0])));
    wire signed [WHOLE-1:0] rounded = floor + {{(WHOLE - 1){1'b0}}, increment};

    wire sign = rounded[WHOLE-1];
    wire fits = rounded[WHOLE-1:OUT_BITS-1] == {(WHOLE - OUT_BITS + 1){sign}};
    assign out = fits ? rounded[OUT_BITS-1:0] : {sign, {(OUT_BITS - 1){!sign}}};
endmodule
