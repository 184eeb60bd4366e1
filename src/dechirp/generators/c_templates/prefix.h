/* {{ name }}.h: range-Doppler map and cell-averaging CFAR of one frame, in whole numbers.
 *
 * {{ banner }}
 * Every word equals that of `dechirp fixed-point` for the same settings.
 *
 *     static {{ name }}_state state;
 *     static {{ name }}_word cube[{{ NAME }}_CUBE_WORDS];
 *     {{ name }}_detection detections[16];
 *
 *     {{ name }}_initialise(&state, cube);
 *     for (;;) {
 *         for (chirp = 0; chirp < {{ NAME }}_N_CHIRPS_SENT; ++chirp)
 *             {{ name }}_push_chirp(&state, samples_of_chirp);
 *         {{ name }}_finish_frame(&state);
 *         while ((n = {{ name }}_read_detections(&state, detections, 16)) > 0)
 *             ... use n detections ...
 *     }
 *
 * All memory is in the state and in the cube. Two states with two cubes let one frame arrive while
 * another one is read.
 */
#ifndef {{ NAME }}_H
#define {{ NAME }}_H

#include <stddef.h>
#include <stdint.h>

#define {{ NAME }}_N_SAMPLES {{ n_samples }}U /* in a chirp */
#define {{ NAME }}_N_RX {{ n_rx }}U
#define {{ NAME }}_N_SLOTS {{ n_slots }}U /* chirps of a round, one after the other */
#define {{ NAME }}_N_CHIRPS {{ n_chirps }}U /* of each slot in a frame */
#define {{ NAME }}_N_CHIRPS_SENT ({{ NAME }}_N_CHIRPS * {{ NAME }}_N_SLOTS)
#define {{ NAME }}_N_CHANNELS ({{ NAME }}_N_SLOTS * {{ NAME }}_N_RX)
#define {{ NAME }}_N_RANGE_BINS {{ n_range_bins }}U /* of the transform */
#define {{ NAME }}_N_ROWS {{ n_rows }}U /* range bins of the map */
#define {{ NAME }}_N_VELOCITY_BINS {{ n_velocity_bins }}U
#define {{ NAME }}_FIRST_SEARCHED_ROW {{ first_searched_row }}U
#define {{ NAME }}_N_SEARCHED_ROWS {{ n_searched_rows }}U

#define {{ NAME }}_SAMPLE_BITS {{ words.sample_bits }}U
#define {{ NAME }}_SAMPLE_PARTS {{ sample_parts }}U /* {{ "I, then Q" if sample_parts == 2 else "real samples" }} */
#define {{ NAME }}_CHIRP_WORDS ({{ NAME }}_N_RX * {{ NAME }}_N_SAMPLES * {{ NAME }}_SAMPLE_PARTS)
#define {{ NAME }}_CUBE_WORDS \
    (2U * {{ NAME }}_N_CHANNELS * {{ NAME }}_N_ROWS * {{ NAME }}_N_VELOCITY_BINS)

/* Range of bin k: k x {{ range_step_m }} m. Velocity of bin k:
 * (k - {{ NAME }}_N_VELOCITY_BINS / 2) x {{ velocity_step_m_per_s }} m/s, positive for receding echoes.
 */

/* Lines of the map that the detector keeps, and rows of its training and guard cells per side. */
#define {{ NAME }}_HALF_VELOCITY {{ half_velocity }}U
#define {{ NAME }}_GUARD_VELOCITY {{ guard_velocity }}U
#define {{ NAME }}_HALF_RANGE {{ half_range }}U
#define {{ NAME }}_GUARD_RANGE {{ guard_range }}U
#define {{ NAME }}_N_LINES (2U * {{ NAME }}_HALF_VELOCITY + 1U)

#define {{ NAME }}_N_WORK_POINTS {{ [n_range_bins, n_velocity_bins] | max }}U

typedef {{ sample_type }} {{ name }}_sample; /* {{ words.sample_bits }} bits are used */
typedef {{ word_type }} {{ name }}_word; /* {{ words.range_bits }} bits for range, {{ words.doppler_bits }} for Doppler */

typedef enum {
    {{ NAME }}_OK = 0,
    {{ NAME }}_TOO_MANY_CHIRPS, /* finish the frame first */
    {{ NAME }}_TOO_FEW_CHIRPS, /* push all chirps first: after a finished frame, those of the next */
    {{ NAME }}_SAMPLE_TOO_LARGE  /* a sample needs more than {{ NAME }}_SAMPLE_BITS; chirp ignored */
} {{ name }}_status;

typedef struct {
    uint32_t velocity_bin;
    uint32_t range_bin;
    uint64_t power; /* {{ words.power_bits }} bits */
    uint64_t threshold;
    uint32_t log_power; /* log2(power) with {{ words.log_fraction_bits }} bits behind the point */
} {{ name }}_detection;

typedef struct {
    {{ name }}_word *cube; /* [channel][row][velocity][I, Q], before the frame ends [chirp] */
    uint32_t n_chirps_pushed;
    uint32_t is_finished;
    uint32_t range_exponent; /* largest one of the frame */
    uint32_t doppler_exponent; /* largest one of the frame */
    uint8_t range_exponents[{{ NAME }}_N_CHIRPS][{{ NAME }}_N_CHANNELS];
    uint8_t doppler_exponents[{{ NAME }}_N_CHANNELS][{{ NAME }}_N_ROWS];
    int32_t real_parts[{{ NAME }}_N_WORK_POINTS]; /* of one transform */
    int32_t imaginary_parts[{{ NAME }}_N_WORK_POINTS];
    uint32_t velocity_bin; /* the cell that is read next */
    uint32_t searched_row;
    uint64_t lines[{{ NAME }}_N_LINES][{{ NAME }}_N_ROWS]; /* powers around velocity_bin */
    uint64_t box_sums[{{ NAME }}_N_SEARCHED_ROWS]; /* over the lines of the box */
    uint64_t guard_sums[{{ NAME }}_N_SEARCHED_ROWS]; /* over the lines of the guard cells */
    uint64_t thresholds[{{ NAME }}_N_SEARCHED_ROWS];
} {{ name }}_state;

#ifdef __cplusplus
extern "C" {
#endif

/* Prepare a state; the caller provides the buffer of the corner turn, {{ NAME }}_CUBE_WORDS long. */
void {{ name }}_initialise({{ name }}_state *state, {{ name }}_word *cube);

/* Process the next chirp of a frame, {{ NAME }}_CHIRP_WORDS samples in the order [rx][sample]{{ "[I, Q]" if sample_parts == 2 }}.
 * The first chirp after a finished frame starts the next one.
 */
{{ name }}_status {{ name }}_push_chirp({{ name }}_state *state, const {{ name }}_sample *samples);

/* Transform all range bins over the chirps. A second call before the next chirp changes nothing and
 * returns {{ NAME }}_TOO_FEW_CHIRPS: it asks for a frame without chirps.
 */
{{ name }}_status {{ name }}_finish_frame({{ name }}_state *state);

/* Write the next detections, `capacity` at most, and return their number; 0 after the last one.
 * Velocity bins ascend, then range bins.
 */
size_t {{ name }}_read_detections(
    {{ name }}_state *state, {{ name }}_detection *detections, size_t capacity);

#ifdef {{ NAME }}_TRACE
/* Words of all stages, for a test bench: call for call in the order of the test vectors. */
typedef enum {
{% for stage in traced_stages %}
    {{ NAME }}_TRACE_{{ stage.name | upper }}{{ "," if not loop.last }}
{% endfor %}
} {{ name }}_traced_stage;

void {{ name }}_trace({{ name }}_traced_stage stage, int64_t word);
#endif

#ifdef __cplusplus
}
#endif

#endif

/* Settings of radar and chain:
 *
{% for line in settings_lines %}
 * {{ line }}
{% endfor %}
 */
