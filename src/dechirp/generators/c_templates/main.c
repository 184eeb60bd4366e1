/* main.c: compare every word of {{ name }}.c with test vectors, and print the detections.
 *
 * {{ banner }}
 *
 *     {{ name }}_check FOLDER
 *
 * FOLDER contains the vectors of one frame, written by `dechirp fixed-point` for the same settings.
 * The exit status is 0 if all words are equal, 1 if some differ, and 2 if a file cannot be read.
 */
#include <stdio.h>
#include <stdlib.h>

#ifndef {{ NAME }}_TRACE
#error "compile with -D{{ NAME }}_TRACE, as the Makefile does, to compare the words of all stages"
#endif
#include "{{ name }}.h"

typedef struct {
    const char *name;
    unsigned bits;
    FILE *file;
    unsigned long n_words;
    unsigned long n_different;
} vector_file;

/* In the order of {{ name }}_traced_stage. */
static vector_file stage_files[] = {
{% for stage in traced_stages %}
    {"{{ stage.name }}", {{ stage.bits }}, NULL, 0, 0}{{ "," if not loop.last }}
{% endfor %}
};
static vector_file sample_files[] = {
{% for sample_file in sample_files %}
    {"{{ sample_file }}", {{ words.sample_bits }}, NULL, 0, 0}{{ "," if not loop.last }}
{% endfor %}
};
#define N_STAGES (sizeof stage_files / sizeof stage_files[0])

static const char *folder;
static {{ name }}_state state;
static {{ name }}_word cube[{{ NAME }}_CUBE_WORDS];
static {{ name }}_sample samples[{{ NAME }}_CHIRP_WORDS];
static {{ name }}_detection detections[64];

static void open_file(vector_file *vectors)
{
    char path[1024];
    const int length = snprintf(path, sizeof path, "%s/%s.hex", folder, vectors->name);

    vectors->file = length > 0 && (size_t)length < sizeof path ? fopen(path, "r") : NULL;
    if (vectors->file == NULL) {
        fprintf(stderr, "%s/%s.hex: cannot be opened; write it with dechirp fixed-point "
                "for the same settings\n", folder, vectors->name);
        exit(2);
    }
}

/* Read the next word, as an unsigned number; return 0 at the end of the file. */
static int read_next_number(vector_file *vectors, uint64_t *word)
{
    char line[32], *end;

    if (fgets(line, sizeof line, vectors->file) == NULL) {
        return 0;
    }
    *word = strtoull(line, &end, 16);
    if (end == line || (*end != '\n' && *end != '\r' && *end != '\0')) {
        fprintf(stderr, "%s.hex: no hexadecimal word in line %lu\n", vectors->name,
                vectors->n_words + 1);
        exit(2);
    }
    ++vectors->n_words;
    return 1;
}

void {{ name }}_trace({{ name }}_traced_stage stage, int64_t word)
{
    vector_file *const vectors = &stage_files[stage];
    const uint64_t found = (uint64_t)word & (((uint64_t)1 << vectors->bits) - 1U);
    uint64_t expected = 0;

    if (!read_next_number(vectors, &expected)) {
        fprintf(stderr, "%s.hex: only %lu words; write it with the same settings\n", vectors->name,
                vectors->n_words);
        exit(2);
    }
    if (found != expected && vectors->n_different++ == 0) {
        fprintf(stderr, "%s, word %lu: %llx, expected %llx\n", vectors->name, vectors->n_words,
                (unsigned long long)found, (unsigned long long)expected);
    }
}

static void read_chirp(void)
{
    const uint64_t sign = (uint64_t)1 << ({{ NAME }}_SAMPLE_BITS - 1U);
    size_t k;

    for (k = 0; k < {{ NAME }}_CHIRP_WORDS; ++k) {
        uint64_t word = 0;
        if (!read_next_number(&sample_files[k % {{ NAME }}_SAMPLE_PARTS], &word) || word >= 2U * sign) {
            fprintf(stderr, "samples: too few, or too long; write them with the same settings\n");
            exit(2);
        }
        samples[k] = ({{ name }}_sample)((int64_t)(word ^ sign) - (int64_t)sign);
    }
}

static void exit_unless_ok({{ name }}_status status)
{
    if (status != {{ NAME }}_OK) {
        fprintf(stderr, "status %d\n", (int)status);
        exit(2);
    }
}

int main(int argc, char **argv)
{
    unsigned long n_words = 0, n_different = 0, n_detections = 0;
    size_t n, k;
    uint32_t chirp;

    folder = argc > 1 ? argv[1] : "vectors";
    for (k = 0; k < N_STAGES; ++k) {
        open_file(&stage_files[k]);
    }
    for (k = 0; k < {{ NAME }}_SAMPLE_PARTS; ++k) {
        open_file(&sample_files[k]);
    }
    {{ name }}_initialise(&state, cube);
    for (chirp = 0; chirp < {{ NAME }}_N_CHIRPS_SENT; ++chirp) {
        read_chirp();
        exit_unless_ok({{ name }}_push_chirp(&state, samples));
    }
    exit_unless_ok({{ name }}_finish_frame(&state));
    printf("velocity_bin range_bin power threshold log_power\n");
    while ((n = {{ name }}_read_detections(&state, detections, 64)) > 0) {
        for (k = 0; k < n; ++k) {
            printf("%lu %lu %llu %llu %lu\n", (unsigned long)detections[k].velocity_bin,
                   (unsigned long)detections[k].range_bin, (unsigned long long)detections[k].power,
                   (unsigned long long)detections[k].threshold,
                   (unsigned long)detections[k].log_power);
        }
        n_detections += (unsigned long)n;
    }
    printf("%lu detections\n", n_detections);
    for (k = 0; k < N_STAGES; ++k) {
        uint64_t word;
        n_words += stage_files[k].n_words;
        n_different += stage_files[k].n_different;
        if (read_next_number(&stage_files[k], &word)) {
            fprintf(stderr, "%s.hex: more words than the settings have\n", stage_files[k].name);
            exit(2);
        }
    }
    printf("%lu words compared, %lu differ\n", n_words, n_different);
    return n_different > 0;
}
