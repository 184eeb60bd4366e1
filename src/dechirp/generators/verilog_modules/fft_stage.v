// One stage of a streaming FFT of radix 2^2: a butterfly of decimation in frequency with single-path
// delay feedback, one sample a clock.
//
// The first DELAY samples of a run, a, enter the delay line; the next ones, b, meet them: a + b
// leaves at once, a - b takes the place of a and leaves during the next run. The first stage of a
// pair has no more than that. The second one takes -i b for b in the second half of a transform,
// which is exact, and multiplies what leaves by W from a table outside: the address selects it two
// clocks before the word is needed. The last stage of a transform has no factors. Sums and products
// are exact; each result is rounded once, as in the model.
//
// A result appears DELAY + 5 clocks after its first sample with factors, else DELAY + 2 clocks after
// it; with block scaling (a SCALING_SHIFT of -1), one transform and two clocks later.
module dechirp_fft_stage #(
    parameter BITS = 16,
    parameter TWIDDLE_BITS = 16,
    parameter INDEX_BITS = 8,
    parameter STAGE = 2,         // 1 for the first
    parameter NATURAL_INPUT = 1, // 1: natural order in, bit-reversed out; 0: the reverse
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
    output wire [INDEX_BITS-1:0]        out_position,  // of the word that leaves next; for W
    input  wire [2*TWIDDLE_BITS-1:0]    twiddle,   // imaginary, real part
    output reg  [INDEX_BITS-1:0]        out_index,
    output reg  signed [BITS-1:0]       out_re,
    output reg  signed [BITS-1:0]       out_im,
    output wire [EXPONENT_BITS-1:0]     out_exponent
);
    localparam IS_SECOND = STAGE % 2 == 0;
    localparam HAS_FACTORS = IS_SECOND && STAGE < INDEX_BITS;
    localparam DELAY_BITS = NATURAL_INPUT ? INDEX_BITS - STAGE : STAGE - 1;
    localparam HALF_BIT = NATURAL_INPUT ? DELAY_BITS + 1 : DELAY_BITS - 1;  // of the pair
    localparam DELAY = 1 << DELAY_BITS;
    localparam CLOCKS = HAS_FACTORS ? 5 : 2;
    localparam SUM_BITS = BITS + 1;
    localparam DELAYED_BITS = HAS_FACTORS ? SUM_BITS : BITS;
    localparam FIXED_SHIFT = SCALING_SHIFT < 0 ? 0 : SCALING_SHIFT;
    localparam MAX_AMOUNT = SCALING_SHIFT < 0 ? 2 : 0;
    localparam [31:0] DELAY_32 = DELAY, LAG = DELAY + CLOCKS;

    // Words of this transform, and its shift.
    wire [INDEX_BITS-1:0] index;
    wire signed [BITS-1:0] re, im;
    wire [1:0] shift, leaving_shift;  // of the sample, and of the word that leaves next
    assign out_position = index - DELAY_32[INDEX_BITS-1:0];
    generate
        if (SCALING_SHIFT < 0) begin : block_scaling
            wire [EXPONENT_BITS-1:0] exponent;
            dechirp_block_scaling #(BITS, INDEX_BITS, EXPONENT_BITS, LIMITS) scaling (
                clk, rst, en, in_index, in_re, in_im, in_exponent, index, re, im, shift, exponent
            );
            // Shift and exponent of a transform stay until its last word has left.
            reg  [1:0] held_shift;
            reg  [CLOCKS*EXPONENT_BITS-1:0] exponents;
            wire starts = out_position == {INDEX_BITS{1'b0}};
            always @(posedge clk) begin
                if (en) begin
                    if (starts) held_shift <= shift;
                    exponents <= {
                        exponents[(CLOCKS-1)*EXPONENT_BITS-1:0],
                        starts ? exponent : exponents[EXPONENT_BITS-1:0]
                    };
                end
            end
            assign leaving_shift = held_shift;
            assign out_exponent = exponents[CLOCKS*EXPONENT_BITS-1 -: EXPONENT_BITS];
        end else begin : fixed_scaling
            assign index = in_index;
            assign re = in_re;
            assign im = in_im;
            assign shift = 2'd0;
            assign leaving_shift = 2'd0;
            assign out_exponent = in_exponent;
        end
    endgenerate
    // A step later `index` is higher by one.
    always @(posedge clk) if (en) out_index <= index + 1'b1 - LAG[INDEX_BITS-1:0];

    // Butterfly, and its delay line, which is one clock shorter than DELAY for the register before it.
    wire second = index[DELAY_BITS];  // the sample is a b
    wire turned;                      // -i b takes its place
    wire signed [SUM_BITS-1:0] wide_re = {re[BITS-1], re}, wide_im = {im[BITS-1], im};
    wire signed [SUM_BITS-1:0] b_re = turned ? wide_im : wide_re;
    wire signed [SUM_BITS-1:0] b_im = turned ? -wide_re : wide_im;
    reg  signed [BITS-1:0] re_1, im_1;
    reg  second_1;
    wire [DELAYED_BITS-1:0] delayed_re, delayed_im;
    wire signed [BITS-1:0] a_re = DELAY == 1 ? re_1 : delayed_re[BITS-1:0];
    wire signed [BITS-1:0] a_im = DELAY == 1 ? im_1 : delayed_im[BITS-1:0];
    wire signed [SUM_BITS-1:0] wide_a_re = {a_re[BITS-1], a_re}, wide_a_im = {a_im[BITS-1], a_im};
    reg  signed [SUM_BITS-1:0] plus_re, plus_im, minus_re, minus_im;
    reg  [DELAYED_BITS-1:0] delayed_re_1, delayed_im_1;
    wire [DELAYED_BITS-1:0] difference_re, difference_im, first_re, first_im;
    dechirp_delay_line #(2 * DELAYED_BITS, DELAY - 1) feedback (
        clk, rst, en,
        second_1 ? {difference_im, difference_re} : {first_im, first_re},
        {delayed_im, delayed_re}
    );
    always @(posedge clk) begin
        if (en) begin
            re_1 <= re;
            im_1 <= im;
            second_1 <= second;
            plus_re <= wide_a_re + b_re;
            plus_im <= wide_a_im + b_im;
            minus_re <= wide_a_re - b_re;
            minus_im <= wide_a_im - b_im;
            delayed_re_1 <= delayed_re;
            delayed_im_1 <= delayed_im;
        end
    end

    generate
        if (IS_SECOND) begin : turns
            assign turned = index[HALF_BIT];
        end else begin : no_turns
            assign turned = 1'b0;
        end

        if (HAS_FACTORS) begin : factors
            wire unused = &{1'b0, delayed_re[BITS], delayed_im[BITS]};
            reg  signed [SUM_BITS-1:0] leaving_re, leaving_im;
            reg  signed [TWIDDLE_BITS-1:0] c, s;
            reg  signed [SUM_BITS+TWIDDLE_BITS-1:0] re_c, im_s, re_s, im_c;
            reg  signed [SUM_BITS+TWIDDLE_BITS:0] product_re, product_im;
            reg  [1:0] shift_2, shift_3, shift_4;
            wire signed [BITS-1:0] word_re, word_im;
            assign first_re = {re_1[BITS-1], re_1};
            assign first_im = {im_1[BITS-1], im_1};
            assign difference_re = minus_re;
            assign difference_im = minus_im;
            always @(posedge clk) begin
                if (en) begin
                    leaving_re <= second_1 ? plus_re : delayed_re_1;
                    leaving_im <= second_1 ? plus_im : delayed_im_1;
                    c <= twiddle[TWIDDLE_BITS-1:0];
                    s <= twiddle[2*TWIDDLE_BITS-1:TWIDDLE_BITS];
                    re_c <= leaving_re * c;
                    im_s <= leaving_im * s;
                    re_s <= leaving_re * s;
                    im_c <= leaving_im * c;
                    product_re <= {re_c[SUM_BITS+TWIDDLE_BITS-1], re_c}
                        - {im_s[SUM_BITS+TWIDDLE_BITS-1], im_s};
                    product_im <= {re_s[SUM_BITS+TWIDDLE_BITS-1], re_s}
                        + {im_c[SUM_BITS+TWIDDLE_BITS-1], im_c};
                    shift_2 <= leaving_shift;
                    shift_3 <= shift_2;
                    shift_4 <= shift_3;
                    out_re <= word_re;
                    out_im <= word_im;
                end
            end
            wire unused_shift = &{1'b0, shift};
            dechirp_round_saturate #(
                SUM_BITS + TWIDDLE_BITS + 1, TWIDDLE_BITS - 2 + FIXED_SHIFT, 2, MAX_AMOUNT, BITS,
                ROUNDING
            )
                round_re (product_re, shift_4, word_re),
                round_im (product_im, shift_4, word_im);
        end else begin : no_factors
            wire unused = &{1'b0, twiddle, leaving_shift};
            reg  [1:0] shift_1;
            wire signed [BITS-1:0] sum_re, sum_im;
            assign first_re = re_1;
            assign first_im = im_1;
            always @(posedge clk) begin
                if (en) begin
                    shift_1 <= shift;
                    out_re <= second_1 ? sum_re : delayed_re_1;
                    out_im <= second_1 ? sum_im : delayed_im_1;
                end
            end
            dechirp_round_saturate #(SUM_BITS, FIXED_SHIFT, 2, MAX_AMOUNT, BITS, ROUNDING)
                round_sum_re (plus_re, shift_1, sum_re),
                round_sum_im (plus_im, shift_1, sum_im),
                round_difference_re (minus_re, shift_1, difference_re),
                round_difference_im (minus_im, shift_1, difference_im);
        end
    endgenerate
endmodule
