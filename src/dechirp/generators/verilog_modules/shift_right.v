// Shift a word right by SHIFT + amount bits; combinational. The bits that leave are kept as two:
// the first one behind the point, and whether any bit behind that one is set.
//
// A negative SHIFT shifts left.
module dechirp_shift_right #(
    parameter IN_BITS = 34,
    parameter SHIFT = 15,
    parameter AMOUNT_BITS = 1,
    parameter MAX_AMOUNT = 0,
    parameter OUT_BITS = 35
) (
    input  wire signed [IN_BITS-1:0]  in,
    input  wire [AMOUNT_BITS-1:0]     amount,
    output wire signed [OUT_BITS-1:0] floor,
    output wire                       half,
    output wire                       beyond
);
    localparam LEFT = SHIFT < 0 ? -SHIFT : 0;
    localparam RIGHT = SHIFT > 0 ? SHIFT : 0;
    localparam FRACTION = RIGHT + MAX_AMOUNT + 2;

    wire signed [OUT_BITS-1:0] extended = {{(OUT_BITS - IN_BITS){in[IN_BITS-1]}}, in};
    wire signed [OUT_BITS+FRACTION-1:0] aligned = {extended <<< LEFT, {FRACTION{1'b0}}};
    wire signed [OUT_BITS+FRACTION-1:0] shifted = (aligned >>> RIGHT) >>> amount;
    assign floor = shifted[OUT_BITS+FRACTION-1:FRACTION];
    assign half = shifted[FRACTION-1];
    assign beyond = |shifted[FRACTION-2:0];
endmodule
