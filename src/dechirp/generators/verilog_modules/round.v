// Round a shifted word, and saturate it; combinational.
//
// ROUNDING: 0 convergent, 1 half-up, 2 truncate. The highest two bits of the input are equal, so
// that rounding cannot overflow it.
module dechirp_round #(
    parameter IN_BITS = 35,
    parameter OUT_BITS = 16,
    parameter ROUNDING = 0
) (
    input  wire signed [IN_BITS-1:0]  floor,
    input  wire                       half,
    input  wire                       beyond,
    output wire signed [OUT_BITS-1:0] out
);
    wire increment = half && (ROUNDING == 1 || (ROUNDING == 0 && (beyond || floor[0])));
    wire signed [IN_BITS-1:0] rounded = floor + {{(IN_BITS - 1){1'b0}}, increment};

    wire sign = rounded[IN_BITS-1];
    wire fits = rounded[IN_BITS-1:OUT_BITS-1] == {(IN_BITS - OUT_BITS + 1){sign}};
    assign out = fits ? rounded[OUT_BITS-1:0] : {sign, {(OUT_BITS - 1){!sign}}};
endmodule
