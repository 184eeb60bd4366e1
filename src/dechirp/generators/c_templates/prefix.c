/* {{ name }}.c: range-Doppler map and cell-averaging CFAR of one frame, in whole numbers.
 *
 * {{ banner }}
 */
#include "{{ name }}.h"

#include "{{ name }}_tables.h"

#ifdef {{ NAME }}_TRACE
#define TRACE(stage, word) {{ name }}_trace({{ NAME }}_TRACE_##stage, (int64_t)(word))
#else
#define TRACE(stage, word) ((void)0)
#endif

/* --- Arithmetic -------------------------------------------------------------------------- */

/* Holds all products and sums of a stage exactly: {{ accumulator_bits_needed }} bits are needed. */
typedef {{ accumulator_type }} accumulator;

#define MAX_SHIFT {{ max_shift }}U /* beyond it only the sign remains */
#define TWIDDLE_FRACTION_BITS {{ words.twiddle_bits - 2 }}U
#define RANGE_PRODUCT_SHIFT ({{ range_product_shift }})     /* bits to the right; to the left if negative */
#define DOPPLER_PRODUCT_SHIFT ({{ doppler_product_shift }}) /* for the largest exponent */
#define POWER_SHIFT ({{ -power_left_shift }})
#define FACTOR_SHIFT {{ factor_shift }}U
#define LARGEST_POWER (((uint64_t)1 << {{ words.power_bits }}) - 1U)
#define LOG_FRACTION_BITS {{ words.log_fraction_bits }}U
#define LOG_TABLE_BITS {{ words.log_table_bits }}U

/* Return floor(x / 2^n). C leaves the right shift of negative numbers to the compiler; compilers
 * turn these two shifts of positive numbers into one instruction.
 */
static inline accumulator shift_right(accumulator x, uint32_t n)
{
    return x < 0 ? ~(~x >> n) : x >> n;
}

/* Return x / 2^n, {{ rounding_text }}. */
static inline accumulator round_shifted(accumulator x, uint32_t n)
{
{% if words.rounding == "truncate" %}
    return shift_right(x, n);
{% elif words.rounding == "half-up" %}
    return shift_right(x + ((accumulator)1 << (n - 1U)), n);
{% else %}
    /* Add just below a half to even results, a half to odd ones. */
    const accumulator half = (accumulator)1 << (n - 1U);
    return shift_right(x + half - 1 + (shift_right(x, n) & 1), n);
{% endif %}
}

/* Return x / 2^shift, rounded; to the left where the shift is negative. */
static inline accumulator scale(accumulator x, int32_t shift)
{
    if (shift <= 0) {
        return x * ((accumulator)1 << (uint32_t)-shift);
    }
    return round_shifted(x, (uint32_t)shift < MAX_SHIFT ? (uint32_t)shift : MAX_SHIFT);
}

/* As `scale`, of a power. */
static inline uint64_t scale_power(uint64_t x, int32_t shift)
{
    uint32_t n;
    if (shift <= 0) {
        return x << (uint32_t)-shift;
    }
    n = (uint32_t)shift < 62U ? (uint32_t)shift : 62U;
{% if words.rounding == "truncate" %}
    return x >> n;
{% elif words.rounding == "half-up" %}
    return (x + ((uint64_t)1 << (n - 1U))) >> n;
{% else %}
    return (x + (((uint64_t)1 << (n - 1U)) - 1U) + ((x >> n) & 1U)) >> n;
{% endif %}
}

/* Return the nearest value from -top - 1 to top. */
static inline int32_t saturate(accumulator x, int32_t top)
{
    return (int32_t)(x > top ? top : x < -top - 1 ? -top - 1 : x);
}

/* --- Transforms ---------------------------------------------------------------------------- */

typedef struct {
    uint32_t n_stages;
    int32_t top;                  /* largest part of a word */
    const {{ twiddle_type }} *cosines; /* Re and Im of W after each pair of stages, the first pair */
    const {{ twiddle_type }} *sines;   /* first, in the order of its last three quarters */
    const uint32_t *growth;       /* of the largest part in each stage, in words of W */
} transform_plan;

static const transform_plan range_plan = {
    {{ n_range_stages }}U, {{ range_top }}, range_cosines, range_sines, range_growth};
static const transform_plan doppler_plan = {
    {{ n_doppler_stages }}U, {{ doppler_top }}, doppler_cosines, doppler_sines, doppler_growth};

/* Return the successor of j in bit-reversed order: 0, n/2, n/4, 3n/4, ... */
static inline uint32_t next_bit_reversed(uint32_t j, uint32_t n)
{
    uint32_t bit = n >> 1;
    while ((j & bit) != 0U) {
        j ^= bit;
        bit >>= 1;
    }
    return j | bit;
}

/* Return a word of the result from its sum x before the shift. */
static inline int32_t round_and_limit(accumulator x, uint32_t shift, int32_t top)
{
{% if words.scaling == "block" %}
    (void)top; /* the shifts prevent overflow */
    return (int32_t)round_shifted(x, shift);
{% else %}
    return saturate(round_shifted(x, shift), top);
{% endif %}
}

/* Return a word of the result from a sum x of words. */
static inline int32_t round_sum(accumulator x, uint32_t shift, int32_t top)
{
    return shift == 0U ? saturate(x, top) : round_and_limit(x, shift, top);
}

/* Replace a and b by a + b and a - b. */
static inline void add_and_subtract(int32_t *a, int32_t *b, uint32_t shift, int32_t top)
{
    const accumulator sum = (accumulator)*a + *b, difference = (accumulator)*a - *b;
    *a = round_sum(sum, shift, top);
    *b = round_sum(difference, shift, top);
}

/* First stage of a pair: replace the points a of one half and b of the other by a + b and a - b. */
static void split_into_halves(
    uint32_t half, int32_t *restrict a_re, int32_t *restrict a_im, int32_t *restrict b_re,
    int32_t *restrict b_im, uint32_t shift, int32_t top)
{
    uint32_t k;
    for (k = 0; k < half; ++k) {
        add_and_subtract(&a_re[k], &b_re[k], shift, top);
        add_and_subtract(&a_im[k], &b_im[k], shift, top);
    }
}

/* As `split_into_halves`, of the points a and b. */
static inline void split_points(
    int32_t *re, int32_t *im, uint32_t a, uint32_t b, uint32_t shift, int32_t top)
{
    add_and_subtract(&re[a], &re[b], shift, top);
    add_and_subtract(&im[a], &im[b], shift, top);
}

/* First stage of the last pair. */
static void split_fours(uint32_t n, int32_t *re, int32_t *im, uint32_t shift, int32_t top)
{
    uint32_t k;
    for (k = 0; k < n; k += 4U) {
        split_points(re, im, k, k + 2U, shift, top);
        split_points(re, im, k + 1U, k + 3U, shift, top);
    }
}

/* Last stage: neighbours; the second one of a pair takes -i b in place of every other b. */
static void split_neighbours(
    uint32_t n, uint32_t is_second, int32_t *re, int32_t *im, uint32_t shift, int32_t top)
{
    uint32_t k;
    for (k = 0; is_second && k < n; k += 4U) {
        const int32_t re_3 = re[k + 3U];
        re[k + 3U] = im[k + 3U];
        im[k + 3U] = -re_3;
    }
    for (k = 0; k < n; k += 2U) {
        split_points(re, im, k, k + 1U, shift, top);
    }
}

/* Second stage of a pair, first half: replace its points a and b by a + b and W (a - b). */
static void split_first_half(
    uint32_t quarter, int32_t *restrict a_re, int32_t *restrict a_im, int32_t *restrict b_re,
    int32_t *restrict b_im, const {{ twiddle_type }} *restrict cosines,
    const {{ twiddle_type }} *restrict sines, uint32_t shift, int32_t top)
{
    uint32_t k;
    for (k = 0; k < quarter; ++k) {
        const accumulator c = cosines[k], s = sines[k];
        const accumulator sum_re = (accumulator)a_re[k] + b_re[k];
        const accumulator sum_im = (accumulator)a_im[k] + b_im[k];
        const accumulator re = (accumulator)a_re[k] - b_re[k], im = (accumulator)a_im[k] - b_im[k];
        a_re[k] = round_sum(sum_re, shift, top);
        a_im[k] = round_sum(sum_im, shift, top);
        b_re[k] = round_and_limit(re * c - im * s, TWIDDLE_FRACTION_BITS + shift, top);
        b_im[k] = round_and_limit(re * s + im * c, TWIDDLE_FRACTION_BITS + shift, top);
    }
}

/* Second stage of a pair, second half: replace a and b by W (a - i b) and W (a + i b); the second
 * W is `quarter` entries behind the first.
 */
static void split_second_half(
    uint32_t quarter, int32_t *restrict a_re, int32_t *restrict a_im, int32_t *restrict b_re,
    int32_t *restrict b_im, const {{ twiddle_type }} *restrict cosines,
    const {{ twiddle_type }} *restrict sines, uint32_t shift, int32_t top)
{
    uint32_t k;
    for (k = 0; k < quarter; ++k) {
        const accumulator c = cosines[k], s = sines[k];
        const accumulator next_c = cosines[quarter + k], next_s = sines[quarter + k];
        const accumulator re = (accumulator)a_re[k] + b_im[k], im = (accumulator)a_im[k] - b_re[k];
        const accumulator next_re = (accumulator)a_re[k] - b_im[k];
        const accumulator next_im = (accumulator)a_im[k] + b_re[k];
        a_re[k] = round_and_limit(re * c - im * s, shift, top);
        a_im[k] = round_and_limit(re * s + im * c, shift, top);
        b_re[k] = round_and_limit(next_re * next_c - next_im * next_s, shift, top);
        b_im[k] = round_and_limit(next_re * next_s + next_im * next_c, shift, top);
    }
}
{% if words.scaling == "block" %}

static int32_t largest_magnitude(const int32_t *re, const int32_t *im, uint32_t n)
{
    int32_t highest = 0, lowest = 0;
    uint32_t k;

    for (k = 0; k < n; ++k) {
        highest = re[k] > highest ? re[k] : highest;
        highest = im[k] > highest ? im[k] : highest;
        lowest = re[k] < lowest ? re[k] : lowest;
        lowest = im[k] < lowest ? im[k] : lowest;
    }
    return highest > -lowest ? highest : -lowest;
}
{% endif %}

/* Do one stage of the transforms of 2 half points, with `shift` bits to the right. The factors W of
 * a second stage begin at cosines and sines.
 */
static void split(
    uint32_t n, uint32_t half, uint32_t is_second, int32_t *re, int32_t *im,
    const {{ twiddle_type }} *cosines, const {{ twiddle_type }} *sines, uint32_t shift, int32_t top)
{
    uint32_t first;

    if (half == 1U) {
        split_neighbours(n, is_second, re, im, shift, top);
    } else if (half == 2U && !is_second) {
        split_fours(n, re, im, shift, top);
    } else if (!is_second) {
        for (first = 0; first < n; first += 2U * half) {
            split_into_halves(half, re + first, im + first, re + first + half, im + first + half,
                              shift, top);
        }
    } else {
        for (first = 0; first < n; first += 4U * half) {
            const uint32_t second = first + 2U * half;
            split_first_half(half, re + first, im + first, re + first + half, im + first + half,
                             cosines, sines, shift, top);
            split_second_half(half, re + second, im + second, re + second + half,
                              im + second + half, cosines + half, sines + half,
                              TWIDDLE_FRACTION_BITS + shift, top);
        }
    }
}

/* Transform points in place into bit-reversed order, by decimation in frequency with radix 2^2;
 * write the bits that each stage shifted right, and return their sum.
 *
 * Stages are paired; the last one of an odd number is alone. Each result is rounded once.
 */
static uint32_t transform(const transform_plan *plan, int32_t *re, int32_t *im, uint8_t *shifts)
{
    const uint32_t n = (uint32_t)1 << plan->n_stages;
    const {{ twiddle_type }} *cosines = plan->cosines, *sines = plan->sines;
    uint32_t exponent = 0, stage;

    for (stage = 0; stage < plan->n_stages; ++stage) {
        const uint32_t half = n >> (stage + 1U), is_second = stage & 1U;
        uint32_t shift = {{ {"block": 0, "halving": 1, "none": 0}[words.scaling] }};
{% if words.scaling == "block" %}
        /* The smallest shift for which no result can exceed the largest word. */
        const uint64_t bound = (uint64_t)largest_magnitude(re, im, n) * plan->growth[stage];
        while (bound > (uint64_t)plan->top << (TWIDDLE_FRACTION_BITS + shift)) {
            ++shift;
        }
{% endif %}
        shifts[stage] = (uint8_t)shift;
        exponent += shift;
        split(n, half, is_second, re, im, cosines, sines, shift, plan->top);
        if (is_second) {
            cosines += 3U * half;
            sines += 3U * half;
        }
    }
    return exponent;
}

/* --- One chirp: window, transform, corner turn ---------------------------------------------- */

static void transform_channel(
    {{ name }}_state *state, const {{ name }}_sample *samples, uint32_t chirp, uint32_t channel)
{
    int32_t *const re = state->real_parts, *const im = state->imaginary_parts;
    {{ name }}_word *target =
        state->cube + 2U * ((size_t)channel * {{ NAME }}_N_ROWS * {{ NAME }}_N_VELOCITY_BINS + chirp);
    uint8_t shifts[{{ [n_range_stages, 1] | max }}];
    uint32_t j = 0, k, exponent;

    for (k = 0; k < {{ NAME }}_N_SAMPLES; ++k) {
        const accumulator weight = range_weights[k];
{% if sample_parts == 2 %}
        re[k] = saturate(scale(samples[2U * k] * weight, RANGE_PRODUCT_SHIFT), range_plan.top);
        im[k] = saturate(scale(samples[2U * k + 1U] * weight, RANGE_PRODUCT_SHIFT), range_plan.top);
{% else %}
        re[k] = saturate(scale(samples[k] * weight, RANGE_PRODUCT_SHIFT), range_plan.top);
        im[k] = 0;
{% endif %}
        TRACE(RANGE_WINDOW_I, re[k]);
        TRACE(RANGE_WINDOW_Q, im[k]);
    }
    for (; k < {{ NAME }}_N_RANGE_BINS; ++k) {
        re[k] = 0;
        im[k] = 0;
        TRACE(RANGE_WINDOW_I, 0);
        TRACE(RANGE_WINDOW_Q, 0);
    }
    exponent = transform(&range_plan, re, im, shifts);
    state->range_exponents[chirp][channel] = (uint8_t)exponent;
    if (exponent > state->range_exponent) {
        state->range_exponent = exponent;
    }
    for (k = 0; k < {{ NAME }}_N_ROWS; ++k) {
        target[0] = ({{ name }}_word)re[j];
        target[1] = ({{ name }}_word)im[j];
        target += 2U * {{ NAME }}_N_VELOCITY_BINS;
        TRACE(RANGE_FFT_I, re[j]);
        TRACE(RANGE_FFT_Q, im[j]);
        j = next_bit_reversed(j, {{ NAME }}_N_RANGE_BINS);
    }
    for (k = 0; k < range_plan.n_stages; ++k) {
        TRACE(RANGE_SHIFTS, shifts[k]);
    }
}

void {{ name }}_initialise({{ name }}_state *state, {{ name }}_word *cube)
{
    state->cube = cube;
    state->n_chirps_pushed = 0;
    state->is_finished = 0;
    state->range_exponent = 0;
}

{{ name }}_status {{ name }}_push_chirp({{ name }}_state *state, const {{ name }}_sample *samples)
{
    uint32_t chirp, slot, rx, k;

{% if sample_bits_of_type > words.sample_bits %}
    for (k = 0; k < {{ NAME }}_CHIRP_WORDS; ++k) {
        if (samples[k] > {{ sample_top }} || samples[k] < -{{ sample_top }} - 1) {
            return {{ NAME }}_SAMPLE_TOO_LARGE;
        }
    }
{% endif %}
    if (state->is_finished) {
        {{ name }}_initialise(state, state->cube);
    }
    if (state->n_chirps_pushed == {{ NAME }}_N_CHIRPS_SENT) {
        return {{ NAME }}_TOO_MANY_CHIRPS;
    }
    chirp = state->n_chirps_pushed / {{ NAME }}_N_SLOTS;
    slot = state->n_chirps_pushed % {{ NAME }}_N_SLOTS;
    for (rx = 0; rx < {{ NAME }}_N_RX; ++rx) {
        k = rx * {{ NAME }}_N_SAMPLES * {{ NAME }}_SAMPLE_PARTS;
        transform_channel(state, samples + k, chirp, slot * {{ NAME }}_N_RX + rx);
    }
    ++state->n_chirps_pushed;
    return {{ NAME }}_OK;
}

/* --- End of a frame: Doppler transforms ------------------------------------------------------ */

static void transform_row({{ name }}_state *state, uint32_t channel, uint32_t row)
{
    int32_t *const re = state->real_parts, *const im = state->imaginary_parts;
    {{ name }}_word *const points =
        state->cube
        + 2U * ((size_t)channel * {{ NAME }}_N_ROWS + row) * {{ NAME }}_N_VELOCITY_BINS;
    uint8_t shifts[{{ [n_doppler_stages, 1] | max }}];
    uint32_t j = 0, k, exponent;

    for (k = 0; k < {{ NAME }}_N_CHIRPS; ++k) {
        /* All chirps of all channels are aligned to the largest exponent. */
        const int32_t shift =
            DOPPLER_PRODUCT_SHIFT
            + (int32_t)(state->range_exponent - state->range_exponents[k][channel]);
        const accumulator weight = doppler_weights[k];
        re[k] = saturate(scale(points[2U * k] * weight, shift), doppler_plan.top);
        im[k] = saturate(scale(points[2U * k + 1U] * weight, shift), doppler_plan.top);
        TRACE(DOPPLER_WINDOW_I, re[k]);
        TRACE(DOPPLER_WINDOW_Q, im[k]);
    }
    for (; k < {{ NAME }}_N_VELOCITY_BINS; ++k) {
        re[k] = 0;
        im[k] = 0;
        TRACE(DOPPLER_WINDOW_I, 0);
        TRACE(DOPPLER_WINDOW_Q, 0);
    }
    exponent = transform(&doppler_plan, re, im, shifts);
    state->doppler_exponents[channel][row] = (uint8_t)exponent;
    if (exponent > state->doppler_exponent) {
        state->doppler_exponent = exponent;
    }
    for (k = 0; k < {{ NAME }}_N_VELOCITY_BINS; ++k) {
        points[2U * k] = ({{ name }}_word)re[j];
        points[2U * k + 1U] = ({{ name }}_word)im[j];
        TRACE(DOPPLER_FFT_I, re[j]);
        TRACE(DOPPLER_FFT_Q, im[j]);
        j = next_bit_reversed(j, {{ NAME }}_N_VELOCITY_BINS);
    }
    for (k = 0; k < doppler_plan.n_stages; ++k) {
        TRACE(DOPPLER_SHIFTS, shifts[k]);
    }
}

/* --- Power and detector, line by line over velocity ------------------------------------------ */

/* Sum I^2 + Q^2 over channels, aligned to the largest exponent, for all rows at one velocity. */
static void compute_powers(const {{ name }}_state *state, uint32_t velocity_bin, uint64_t *powers)
{
    uint32_t channel, row;

    for (row = 0; row < {{ NAME }}_N_ROWS; ++row) {
        powers[row] = 0;
    }
    for (channel = 0; channel < {{ NAME }}_N_CHANNELS; ++channel) {
        const {{ name }}_word *point =
            state->cube
            + 2U * ((size_t)channel * {{ NAME }}_N_ROWS * {{ NAME }}_N_VELOCITY_BINS + velocity_bin);
        for (row = 0; row < {{ NAME }}_N_ROWS; ++row) {
            const int64_t re = point[0], im = point[1];
            const uint32_t below = state->doppler_exponent - state->doppler_exponents[channel][row];
            const uint64_t square = (uint64_t)(re * re + im * im);
            powers[row] += scale_power(square, POWER_SHIFT + 2 * (int32_t)below);
            point += 2U * {{ NAME }}_N_VELOCITY_BINS;
        }
    }
}

/* Line of the ring for the velocity that is `offset` lines after velocity_bin - HALF_VELOCITY. */
static inline uint64_t *ring_line({{ name }}_state *state, uint32_t offset)
{
    return state->lines[(state->velocity_bin + offset) % {{ NAME }}_N_LINES];
}

/* Add (or, with `sign` -1 as unsigned number, subtract) the searched rows of a line. */
static void add_line(uint64_t *sums, const uint64_t *powers, uint64_t sign)
{
    uint32_t row;
    for (row = 0; row < {{ NAME }}_N_SEARCHED_ROWS; ++row) {
        sums[row] += sign * powers[{{ NAME }}_FIRST_SEARCHED_ROW + row];
    }
}

/* Return floor(total x factor / 2^FACTOR_SHIFT), or the largest power where that is more. */
static uint64_t multiply_by_factor(uint64_t total, uint32_t factor)
{
    const uint64_t high = (total >> 32) * factor, low = (total & 0xFFFFFFFFU) * factor;
    uint64_t product;
{% if factor_shift < 32 %}
    if ((high >> (30U + FACTOR_SHIFT)) != 0U) {
        return LARGEST_POWER;
    }
    product = (high << (32U - FACTOR_SHIFT)) + (low >> FACTOR_SHIFT);
{% else %}
    product = (high + (low >> 32)) >> (FACTOR_SHIFT - 32U);
{% endif %}
    return product < LARGEST_POWER ? product : LARGEST_POWER;
}

/* Compute the thresholds of the searched rows at velocity_bin from the sums over lines.
 *
 * The box stays within the searched rows: near their ends the cell is off its centre. Boxes of
 * successive rows differ by one row at each end, so sums over rows slide.
 */
static void compute_thresholds({{ name }}_state *state)
{
    const uint32_t width = 2U * {{ NAME }}_HALF_RANGE + 1U;
    uint32_t first = 0, guard_first = 0, guard_end = 0, row, k;
    uint64_t box = 0, guard = 0;

    for (k = 0; k < width; ++k) {
        box += state->box_sums[k];
    }
    for (row = 0; row < {{ NAME }}_N_SEARCHED_ROWS; ++row) {
        if (row > first + {{ NAME }}_HALF_RANGE && first + width < {{ NAME }}_N_SEARCHED_ROWS) {
            box += state->box_sums[first + width] - state->box_sums[first];
            ++first;
        }
        while (guard_end < row + {{ NAME }}_GUARD_RANGE + 1U && guard_end < first + width) {
            guard += state->guard_sums[guard_end++];
        }
        while (guard_first < first || guard_first + {{ NAME }}_GUARD_RANGE < row) {
            guard -= state->guard_sums[guard_first++];
        }
        state->thresholds[row] = multiply_by_factor(box - guard, factors[row]);
    }
}

/* Return log2 of a power: the position of its leading one, and a table addressed by the bits
 * below.
 */
static uint32_t log2_of_power(uint64_t power)
{
    uint32_t leading_bit = 0;
    uint64_t address;
    if (power == 0U) {
        return 0;
    }
    while ((power >> (leading_bit + 1U)) != 0U) {
        ++leading_bit;
    }
    address = power - ((uint64_t)1 << leading_bit);
    if (leading_bit > LOG_TABLE_BITS) {
        address >>= leading_bit - LOG_TABLE_BITS;
    } else {
        address <<= LOG_TABLE_BITS - leading_bit;
    }
    return (leading_bit << LOG_FRACTION_BITS) + logarithms[address];
}

#ifdef {{ NAME }}_TRACE
static void trace_line({{ name }}_state *state)
{
    const uint64_t *const powers = ring_line(state, {{ NAME }}_HALF_VELOCITY);
    uint32_t row;
    for (row = 0; row < {{ NAME }}_N_ROWS; ++row) {
        const uint32_t searched_row = row - {{ NAME }}_FIRST_SEARCHED_ROW; /* wraps below the first */
        const uint64_t threshold = searched_row < {{ NAME }}_N_SEARCHED_ROWS
                                       ? state->thresholds[searched_row]
                                       : LARGEST_POWER;
        TRACE(POWER, powers[row]);
        TRACE(LOG_POWER, log2_of_power(powers[row]));
        TRACE(THRESHOLD, threshold);
        TRACE(DETECTED, powers[row] > threshold);
    }
}
#endif

/* Prepare the detector for the cells at velocity_bin. */
static void finish_line({{ name }}_state *state)
{
    compute_thresholds(state);
    state->searched_row = 0;
#ifdef {{ NAME }}_TRACE
    trace_line(state);
#endif
}

/* Move the detector to the next velocity. Velocity wraps round. */
static void move_to_next_line({{ name }}_state *state)
{
    const uint64_t minus_one = ~(uint64_t)0;
    const uint32_t half = {{ NAME }}_HALF_VELOCITY, guard = {{ NAME }}_GUARD_VELOCITY;
    uint64_t *line = ring_line(state, 0);

    add_line(state->box_sums, line, minus_one);
    add_line(state->guard_sums, ring_line(state, half - guard), minus_one);
    ++state->velocity_bin;
    compute_powers(state, (state->velocity_bin + half) % {{ NAME }}_N_VELOCITY_BINS, line);
    add_line(state->box_sums, line, 1);
    add_line(state->guard_sums, ring_line(state, half + guard), 1);
    finish_line(state);
}

static void start_first_line({{ name }}_state *state)
{
    uint32_t row, k;

    state->velocity_bin = 0;
    for (row = 0; row < {{ NAME }}_N_SEARCHED_ROWS; ++row) {
        state->box_sums[row] = 0;
        state->guard_sums[row] = 0;
    }
    for (k = 0; k < {{ NAME }}_N_LINES; ++k) {
        const uint32_t velocity_bin =
            ({{ NAME }}_N_VELOCITY_BINS + k - {{ NAME }}_HALF_VELOCITY) % {{ NAME }}_N_VELOCITY_BINS;
        compute_powers(state, velocity_bin, state->lines[k]);
        add_line(state->box_sums, state->lines[k], 1);
        if (k + {{ NAME }}_GUARD_VELOCITY + 1U > {{ NAME }}_HALF_VELOCITY
            && k <= {{ NAME }}_HALF_VELOCITY + {{ NAME }}_GUARD_VELOCITY) {
            add_line(state->guard_sums, state->lines[k], 1);
        }
    }
    finish_line(state);
}

{{ name }}_status {{ name }}_finish_frame({{ name }}_state *state)
{
    uint32_t channel, row;

    if (state->is_finished || state->n_chirps_pushed < {{ NAME }}_N_CHIRPS_SENT) {
        return {{ NAME }}_TOO_FEW_CHIRPS;
    }
    state->doppler_exponent = 0;
    for (channel = 0; channel < {{ NAME }}_N_CHANNELS; ++channel) {
        for (row = 0; row < {{ NAME }}_N_ROWS; ++row) {
            transform_row(state, channel, row);
        }
    }
    state->is_finished = 1;
    start_first_line(state);
    return {{ NAME }}_OK;
}

size_t {{ name }}_read_detections(
    {{ name }}_state *state, {{ name }}_detection *detections, size_t capacity)
{
    size_t n = 0;

    if (!state->is_finished) {
        return 0;
    }
    while (n < capacity) {
        const uint64_t *const powers =
            ring_line(state, {{ NAME }}_HALF_VELOCITY) + {{ NAME }}_FIRST_SEARCHED_ROW;
        uint32_t row = state->searched_row;
        for (; row < {{ NAME }}_N_SEARCHED_ROWS && n < capacity; ++row) {
            if (powers[row] > state->thresholds[row]) {
                detections[n].velocity_bin = state->velocity_bin;
                detections[n].range_bin = {{ NAME }}_FIRST_SEARCHED_ROW + row;
                detections[n].power = powers[row];
                detections[n].threshold = state->thresholds[row];
                detections[n].log_power = log2_of_power(powers[row]);
                ++n;
            }
        }
        state->searched_row = row;
        if (row == {{ NAME }}_N_SEARCHED_ROWS) {
            if (state->velocity_bin + 1U == {{ NAME }}_N_VELOCITY_BINS) {
                break;
            }
            move_to_next_line(state);
        }
    }
    return n;
}
