// Streaming FFT, one sample a clock: radix 2^2 with single-path delay feedback.
//
// All stages have the butterflies, twiddle factors and rounding of the model: every other one has
// four multipliers, and the last two have none. With NATURAL_INPUT, words enter in natural and leave
// in bit-reversed order; without it, the reverse. The first result appears 2^INDEX_BITS - 1 clocks
// after its first sample, plus 2 clocks for each stage and 3 for each with factors; with block
// scaling (a SCALING_SHIFT of -1), one transform and two clocks later for each stage.
module dechirp_fft #(
    parameter BITS = 16,
    parameter TWIDDLE_BITS = 16,
    parameter INDEX_BITS = 8,  // log2 of the points
    parameter NATURAL_INPUT = 1,
    parameter SCALING_SHIFT = 1,  // bits in each stage, or -1 for block scaling
    parameter EXPONENT_BITS = 5,
    parameter [2*INDEX_BITS*BITS-1:0] LIMITS = 0,  // two of each stage, the first stage lowest
    parameter ROUNDING = 0
) (
    input  wire                   clk,
    input  wire                   rst,
    input  wire                   en,
    input  wire [INDEX_BITS-1:0]  in_index,  // position of the word in its transform
    input  wire signed [BITS-1:0] in_re,
    input  wire signed [BITS-1:0] in_im,
    output wire signed [BITS-1:0] out_re,
    output wire signed [BITS-1:0] out_im,
    output wire [EXPONENT_BITS-1:0] out_exponent
);
    wire [INDEX_BITS-1:0] index [0:INDEX_BITS];
    wire signed [BITS-1:0] re [0:INDEX_BITS];
    wire signed [BITS-1:0] im [0:INDEX_BITS];
    wire [EXPONENT_BITS-1:0] exponent [0:INDEX_BITS];
    assign index[0] = in_index;
    assign exponent[0] = {EXPONENT_BITS{1'b0}};
    assign out_exponent = exponent[INDEX_BITS];
    assign re[0] = in_re;
    assign im[0] = in_im;
    assign out_re = re[INDEX_BITS];
    assign out_im = im[INDEX_BITS];
    wire unused = &{1'b0, index[INDEX_BITS]};

    genvar j, k;
    generate
        for (j = 1; j <= INDEX_BITS; j = j + 1) begin : stages
            localparam PAIR_BITS = INDEX_BITS - j + 2;  // log2 of the points of the pair
            wire [INDEX_BITS-1:0] position;
            wire [2*TWIDDLE_BITS-1:0] twiddle;
            wire unused_position = &{1'b0, position};
            if (j % 2 == 0 && j < INDEX_BITS) begin : factors
                wire [PAIR_BITS-1:0] address;
                for (k = 0; k < PAIR_BITS; k = k + 1) begin : bits
                    assign address[k] = position[NATURAL_INPUT ? k : INDEX_BITS-1-k];
                end
                dechirp_twiddles #(PAIR_BITS) twiddles (clk, en, address, twiddle);
            end else begin : no_factors
                assign twiddle = {2 * TWIDDLE_BITS{1'b0}};
            end
            dechirp_fft_stage #(
                BITS, TWIDDLE_BITS, INDEX_BITS, j, NATURAL_INPUT, SCALING_SHIFT,
                EXPONENT_BITS, LIMITS[2*BITS*(j-1) +: 2*BITS], ROUNDING
            ) stage (
                clk, rst, en, index[j-1], re[j-1], im[j-1], exponent[j-1], position, twiddle,
                index[j], re[j], im[j], exponent[j]
            );
        end
    endgenerate
endmodule
