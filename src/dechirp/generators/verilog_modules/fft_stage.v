// One stage of a streaming FFT: a radix-2 butterfly of decimation in time with single-path delay
// feedback, one sample a clock.
//
// The first DELAY samples of a run, a, enter the delay line; the next ones, b, meet them:
// a + W b leaves at once, a - W b takes the place of a and leaves during the next run.
// Products and sums are exact; each result is rounded once, as in the model.
//
// TWIDDLES: 0 for W = 1; 1 for W = 1 or -i; 2 for W from a table outside, which the address
// selects one clock before the word is needed. A result appears DELAY + 6 clocks after its first
// sample where W comes from a table, else DELAY + 2 clocks after it; with block scaling (a
// SCALING_SHIFT of -1), one transform and two clocks later.
module dechirp_fft_stage #(
    parameter BITS = 16,
    parameter TWIDDLE_BITS = 16,
    parameter INDEX_BITS = 8,
    parameter STAGE = 3,         // 1 for the first
    parameter NATURAL_INPUT = 1, // 1: natural order in, bit-reversed out; 0: the reverse
    parameter TWIDDLES = 2,
    parameter SCALING_SHIFT = 1, // bits, or -1 for block scaling
    parameter EXPONENT_BITS = 5,
    parameter [2*BITS-1:0] LIMITS = 0,
    parameter ROUNDING = 0
) (
    input  wire                         clk,
    input  wire                         rst,
    input  wire                         en,
    input  wire [INDEX_BITS-1:0]        in_index,  // position in the transform
    input  wire signed [BITS-1:0]       in_re,
    input  wire signed [BITS-1:0]       in_im,
    input  wire [EXPONENT_BITS-1:0]     in_exponent,  // sum of the shifts of earlier stages
    output wire [(STAGE > 1 ? STAGE-2 : 0):0] twiddle_address,
    input  wire [2*TWIDDLE_BITS-1:0]    twiddle,   // imaginary, real part
    output reg  [INDEX_BITS-1:0]        out_index,
    output reg  signed [BITS-1:0]       out_re,
    output reg  signed [BITS-1:0]       out_im,
    output wire [EXPONENT_BITS-1:0]     out_exponent
);
    localparam DELAY_BITS = NATURAL_INPUT ? INDEX_BITS - STAGE : STAGE - 1;
    localparam DELAY = 1 << DELAY_BITS;
    localparam LATENCY = DELAY + (TWIDDLES == 2 ? 6 : 2);
    localparam FRACTION = TWIDDLES == 2 ? TWIDDLE_BITS - 2 : 0;
    localparam PRODUCT_BITS = TWIDDLES == 2 ? BITS + TWIDDLE_BITS + 1 : BITS + 1;
    localparam SUM_BITS = PRODUCT_BITS + 1;
    localparam [31:0] LAG = LATENCY;

    // Words of this transform, and its shift.
    wire [INDEX_BITS-1:0] index;
    wire signed [BITS-1:0] re, im;
    wire [1:0] shift;
    generate
        if (SCALING_SHIFT < 0) begin : block_scaling
            wire [EXPONENT_BITS-1:0] exponent;
            dechirp_block_scaling #(BITS, INDEX_BITS, EXPONENT_BITS, LIMITS) scaling (
                clk, rst, en, in_index, in_re, in_im, in_exponent, index, re, im, shift, exponent
            );
            dechirp_delay_line #(EXPONENT_BITS, LATENCY)
                exponents (clk, rst, en, exponent, out_exponent);
        end else begin : fixed_scaling
            assign index = in_index;
            assign re = in_re;
            assign im = in_im;
            assign shift = 2'd0;
            assign out_exponent = in_exponent;
        end
    endgenerate
    // A step later `index` is higher by one.
    always @(posedge clk) if (en) out_index <= index + 1'b1 - LAG[INDEX_BITS-1:0];

    // Rotation: the sample itself, and W times it, at the input of the butterfly.
    wire second;  // the sample is a b
    wire [1:0] butterfly_shift;
    wire signed [BITS-1:0] x_re, x_im;
    wire signed [PRODUCT_BITS-1:0] rotated_re, rotated_im;
    wire is_second = index[DELAY_BITS];

    genvar k;
    generate
        if (STAGE == 1) begin : address_none
            assign twiddle_address = 1'b0;
        end else if (NATURAL_INPUT) begin : address_reversed
            for (k = 0; k < STAGE - 1; k = k + 1) begin : bits
                assign twiddle_address[k] = index[INDEX_BITS-1-k];
            end
        end else begin : address_natural
            assign twiddle_address = index[STAGE-2:0];
        end

        if (TWIDDLES == 2) begin : multiplier
            reg signed [TWIDDLE_BITS-1:0] c, s;
            reg [3:0] seconds;
            reg [1:0] shift_1, shift_2, shift_3, shift_4;
            reg signed [BITS-1:0] re1, im1, re2, im2, re3, im3, re4, im4;
            reg signed [BITS+TWIDDLE_BITS-1:0] re_c, im_s, re_s, im_c;
            reg signed [PRODUCT_BITS-1:0] sum_re, sum_im;
            always @(posedge clk) begin
                if (en) begin
                    seconds <= {seconds[2:0], is_second};
                    shift_1 <= shift;
                    shift_2 <= shift_1;
                    shift_3 <= shift_2;
                    shift_4 <= shift_3;
                    re1 <= re;
                    im1 <= im;
                    re2 <= re1;
                    im2 <= im1;
                    c <= twiddle[TWIDDLE_BITS-1:0];
                    s <= twiddle[2*TWIDDLE_BITS-1:TWIDDLE_BITS];
                    re_c <= re2 * c;
                    im_s <= im2 * s;
                    re_s <= re2 * s;
                    im_c <= im2 * c;
                    re3 <= re2;
                    im3 <= im2;
                    re4 <= re3;
                    im4 <= im3;
                    sum_re <= {re_c[BITS+TWIDDLE_BITS-1], re_c} - {im_s[BITS+TWIDDLE_BITS-1], im_s};
                    sum_im <= {re_s[BITS+TWIDDLE_BITS-1], re_s} + {im_c[BITS+TWIDDLE_BITS-1], im_c};
                end
            end
            assign second = seconds[3];
            assign butterfly_shift = shift_4;
            assign x_re = re4;
            assign x_im = im4;
            assign rotated_re = sum_re;
            assign rotated_im = sum_im;
        end else begin : quarter_turns
            wire unused = &{1'b0, twiddle};
            wire turned = TWIDDLES == 1 && twiddle_address[0];
            wire signed [BITS:0] wide_re = {re[BITS-1], re};
            wire signed [BITS:0] wide_im = {im[BITS-1], im};
            assign second = is_second;
            assign butterfly_shift = shift;
            assign x_re = re;
            assign x_im = im;
            assign rotated_re = turned ? wide_im : wide_re;
            assign rotated_im = turned ? -wide_re : wide_im;
        end
    endgenerate

    // Butterfly: sums and differences in one clock, rounding in the next.
    wire signed [BITS-1:0] a_re, a_im, sum_re_word, sum_im_word, difference_re, difference_im;
    wire signed [SUM_BITS-1:0] wide_a_re = {{(SUM_BITS - BITS){a_re[BITS-1]}}, a_re} <<< FRACTION;
    wire signed [SUM_BITS-1:0] wide_a_im = {{(SUM_BITS - BITS){a_im[BITS-1]}}, a_im} <<< FRACTION;
    wire signed [SUM_BITS-1:0] wide_b_re = {rotated_re[PRODUCT_BITS-1], rotated_re};
    wire signed [SUM_BITS-1:0] wide_b_im = {rotated_im[PRODUCT_BITS-1], rotated_im};
    reg  signed [SUM_BITS-1:0] plus_re, plus_im, minus_re, minus_im;
    reg  signed [BITS-1:0] x_re_1, x_im_1;
    reg  [1:0] shift_before_rounding;
    reg  second_1;
    always @(posedge clk) begin
        if (en) begin
            plus_re <= wide_a_re + wide_b_re;
            plus_im <= wide_a_im + wide_b_im;
            minus_re <= wide_a_re - wide_b_re;
            minus_im <= wide_a_im - wide_b_im;
            x_re_1 <= x_re;
            x_im_1 <= x_im;
            shift_before_rounding <= butterfly_shift;
            second_1 <= second;
        end
    end

    localparam SHIFT = FRACTION + (SCALING_SHIFT < 0 ? 0 : SCALING_SHIFT);
    localparam MAX_AMOUNT = SCALING_SHIFT < 0 ? 2 : 0;
    dechirp_round_saturate #(SUM_BITS, SHIFT, 2, MAX_AMOUNT, BITS, ROUNDING)
        round_sum_re (plus_re, shift_before_rounding, sum_re_word),
        round_sum_im (plus_im, shift_before_rounding, sum_im_word),
        round_difference_re (minus_re, shift_before_rounding, difference_re),
        round_difference_im (minus_im, shift_before_rounding, difference_im);

    // The delay line is one clock shorter than DELAY, for the register before it.
    wire signed [BITS-1:0] delayed_re, delayed_im;
    dechirp_delay_line #(2 * BITS, DELAY - 1) feedback (
        clk, rst, en,
        second_1 ? {difference_im, difference_re} : {x_im_1, x_re_1},
        {delayed_im, delayed_re}
    );
    assign a_re = DELAY == 1 ? x_re_1 : delayed_re;
    assign a_im = DELAY == 1 ? x_im_1 : delayed_im;

    reg  signed [BITS-1:0] delayed_re_1, delayed_im_1;
    always @(posedge clk) begin
        if (en) begin
            delayed_re_1 <= delayed_re;
            delayed_im_1 <= delayed_im;
            out_re <= second_1 ? sum_re_word : delayed_re_1;
            out_im <= second_1 ? sum_im_word : delayed_im_1;
        end
    end
endmodule
