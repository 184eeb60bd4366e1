// Range-Doppler chain without its corner-turn memory, from samples to cells over the threshold.
//
// Samples enter chirp by chirp, channel by channel within a chirp, sample by sample within a
// channel; frames follow each other without a mark. Cells leave range bin by range bin, velocity
// by velocity. Words are those of the fixed-point model.
//
// The corner-turn memory has two banks, so that one frame enters while the one before leaves. With
// block scaling, a second memory of one frame holds the Doppler spectra until their largest exponent
// is known. Each takes one word a clock and returns the word of an address one clock after the
// enabled read.
module dechirp_core #(
    parameter SAMPLE_BITS = 16,
    parameter COMPLEX_SAMPLES = 1,
    parameter WINDOW_BITS = 16,
    parameter TWIDDLE_BITS = 16,
    parameter RANGE_BITS = 16,
    parameter DOPPLER_BITS = 16,
    parameter POWER_BITS = 48,
    parameter FACTOR_BITS = 16,
    parameter SCALING_SHIFT = 1,       // bits in each stage of a transform, -1 for block scaling
    parameter EXPONENT_BITS = 5,       // 2 in each stage at most
    parameter ROUNDING = 0,            // 0 convergent, 1 half-up, 2 truncate
    parameter N_SAMPLES = 256,
    parameter N_CHANNELS = 1,
    parameter N_CHIRPS = 64,
    parameter RANGE_INDEX_BITS = 8,    // log2 of the points of the range transform
    parameter DOPPLER_INDEX_BITS = 6,  // log2 of the points of the Doppler transform
    parameter N_ROWS = 256,            // range bins that are kept
    parameter ROW_BITS = 8,
    parameter FIRST_SEARCHED = 0,      // range bins in which targets are detected
    parameter N_SEARCHED = 256,
    parameter SEARCHED_BITS = 8,
    parameter CHANNEL_ADDRESS_BITS = 0,
    parameter CHIRP_ADDRESS_BITS = 6,
    parameter RANGE_SHIFT = 14,        // bits behind the point of the product of word and weight
    parameter DOPPLER_SHIFT = 14,
    parameter POWER_SHIFT = -16,
    parameter HALF_RANGE = 14,
    parameter HALF_VELOCITY = 12,
    parameter GUARD_RANGE = 4,
    parameter GUARD_VELOCITY = 4,
    parameter FACTOR_SHIFT = 20,
    parameter [2*RANGE_INDEX_BITS*RANGE_BITS-1:0] RANGE_LIMITS = 0,  // of block scaling
    parameter [2*DOPPLER_INDEX_BITS*DOPPLER_BITS-1:0] DOPPLER_LIMITS = 0,
    parameter ADDRESS_BITS = 1 + ROW_BITS + CHANNEL_ADDRESS_BITS + CHIRP_ADDRESS_BITS,
    parameter TRANSFORM_BITS = 8,      // of the number of a Doppler transform in its frame
    parameter SPECTRUM_ADDRESS_BITS = TRANSFORM_BITS + DOPPLER_INDEX_BITS
) (
    input  wire                          clk,
    input  wire                          rst,
    // Samples: I in the lower, Q in the upper half; I alone for real samples.
    input  wire                          s_axis_tvalid,
    output wire                          s_axis_tready,
    input  wire [(1+COMPLEX_SAMPLES)*SAMPLE_BITS-1:0] s_axis_tdata,
    // Cells: detected, threshold, power; beside them range bin and velocity bin.
    output wire                          m_axis_tvalid,
    input  wire                          m_axis_tready,
    output wire [2*POWER_BITS:0]         m_axis_tdata,
    output wire [RANGE_INDEX_BITS+DOPPLER_INDEX_BITS-1:0] m_axis_tuser,
    output wire                          m_axis_tlast,
    // Corner-turn memory. Nothing moves on a side whose `ready` is 0.
    output wire                          memory_write_en,
    input  wire                          memory_write_ready,
    output wire [ADDRESS_BITS-1:0]       memory_write_address,  // bank, range bin, channel, chirp
    output wire [2*RANGE_BITS-1:0]       memory_write_data,     // imaginary, real part
    output wire                          memory_read_en,
    input  wire                          memory_read_ready,     // also: the last word has arrived
    output wire [ADDRESS_BITS-1:0]       memory_read_address,
    input  wire [2*RANGE_BITS-1:0]       memory_read_data,
    // Memory of the spectra, for block scaling alone.
    output wire                          spectrum_write_en,
    input  wire                          spectrum_write_ready,
    output wire [SPECTRUM_ADDRESS_BITS-1:0] spectrum_write_address,
    output wire [2*DOPPLER_BITS-1:0]     spectrum_write_data,   // imaginary, real part
    output wire                          spectrum_read_en,
    input  wire                          spectrum_read_ready,
    output wire [SPECTRUM_ADDRESS_BITS-1:0] spectrum_read_address,
    input  wire [2*DOPPLER_BITS-1:0]     spectrum_read_data
);
    localparam WINDOW_LATENCY = 5, POWER_LATENCY = 6;
    localparam BLOCK_SCALING = SCALING_SHIFT < 0;
    localparam RANGE_LATENCY = WINDOW_LATENCY + (1 << RANGE_INDEX_BITS) - 1
        + 2 * RANGE_INDEX_BITS + 3 * ((RANGE_INDEX_BITS - 1) / 2)
        + (BLOCK_SCALING ? RANGE_INDEX_BITS * ((1 << RANGE_INDEX_BITS) + 2) : 0);
    localparam DOPPLER_LATENCY = WINDOW_LATENCY + (1 << DOPPLER_INDEX_BITS) - 1
        + 2 * DOPPLER_INDEX_BITS + 3 * ((DOPPLER_INDEX_BITS - 1) / 2)
        + (BLOCK_SCALING ? DOPPLER_INDEX_BITS * ((1 << DOPPLER_INDEX_BITS) + 2) : 0);
    // Largest exponents: two bits in each stage.
    localparam MAX_RANGE_EXPONENT = 2 * RANGE_INDEX_BITS;
    localparam MAX_DOPPLER_EXPONENT = 2 * DOPPLER_INDEX_BITS;
    localparam [EXPONENT_BITS-1:0] NO_EXPONENT = 0;
    localparam CHANNEL_BITS = CHANNEL_ADDRESS_BITS > 0 ? CHANNEL_ADDRESS_BITS : 1;
    localparam [31:0] LAST_CHANNEL_32 = N_CHANNELS - 1, LAST_CHIRP_32 = N_CHIRPS - 1;
    localparam [31:0] LAST_ROW_32 = N_ROWS - 1;
    localparam [31:0] FIRST_SEARCHED_32 = FIRST_SEARCHED, LAST_SEARCHED_32 = N_SEARCHED - 1;
    localparam [31:0] N_SAMPLES_32 = N_SAMPLES, N_CHIRPS_32 = N_CHIRPS;
    localparam [CHANNEL_BITS-1:0] LAST_CHANNEL = LAST_CHANNEL_32[CHANNEL_BITS-1:0];
    localparam [CHIRP_ADDRESS_BITS-1:0] LAST_CHIRP = LAST_CHIRP_32[CHIRP_ADDRESS_BITS-1:0];
    localparam [ROW_BITS-1:0] LAST_ROW = LAST_ROW_32[ROW_BITS-1:0];

    // Banks: full from the last write of a frame to its last read.
    reg  [1:0] full;
    reg  write_bank, read_bank;
    wire frame_written, frame_read;
    always @(posedge clk) begin
        if (rst) begin
            full <= 2'b00;
        end else begin
            if (frame_written) full[write_bank] <= 1'b1;
            if (frame_read) full[read_bank] <= 1'b0;
        end
    end

    // --- Range: window and transform of each chirp, then the memory -----------------------------

    wire [RANGE_INDEX_BITS-1:0] sample;
    wire range_run, range_en, range_accept, range_valid;
    reg  [CHANNEL_BITS-1:0] accept_channel;
    reg  [CHIRP_ADDRESS_BITS-1:0] accept_chirp;
    wire frame_start = accept_channel == {CHANNEL_BITS{1'b0}}
        && accept_chirp == {CHIRP_ADDRESS_BITS{1'b0}};
    wire is_sample = {1'b0, sample} < N_SAMPLES_32[RANGE_INDEX_BITS:0];  // else zero padding
    wire sample_available = !is_sample || s_axis_tvalid;

    dechirp_block_control #(RANGE_INDEX_BITS, RANGE_LATENCY) range_control (
        clk, rst, sample_available, frame_start,
        memory_write_ready && !(range_valid && full[write_bank]),
        range_run, range_en, range_accept, sample, range_valid
    );
    assign s_axis_tready = range_accept && is_sample;

    wire unused_run = range_run;
    wire last_accepted_channel = accept_channel == LAST_CHANNEL;
    wire last_accepted_chirp = accept_chirp == LAST_CHIRP;
    always @(posedge clk) begin
        if (rst) begin
            accept_channel <= {CHANNEL_BITS{1'b0}};
            accept_chirp <= {CHIRP_ADDRESS_BITS{1'b0}};
        end else if (range_accept && &sample) begin
            accept_channel <= last_accepted_channel ? {CHANNEL_BITS{1'b0}} : accept_channel + 1'b1;
            if (last_accepted_channel)
                accept_chirp <= last_accepted_chirp ? {CHIRP_ADDRESS_BITS{1'b0}} : accept_chirp + 1'b1;
        end
    end

    wire signed [SAMPLE_BITS-1:0] in_re = s_axis_tdata[SAMPLE_BITS-1:0];
    wire signed [SAMPLE_BITS-1:0] in_im;
    generate
        if (COMPLEX_SAMPLES) begin : complex_samples
            assign in_im = s_axis_tdata[2*SAMPLE_BITS-1:SAMPLE_BITS];
        end else begin : real_samples
            assign in_im = {SAMPLE_BITS{1'b0}};
        end
    endgenerate
    reg  signed [SAMPLE_BITS-1:0] sample_re, sample_im;
    always @(posedge clk) begin
        if (range_en) begin
            sample_re <= s_axis_tready ? in_re : {SAMPLE_BITS{1'b0}};
            sample_im <= s_axis_tready ? in_im : {SAMPLE_BITS{1'b0}};
        end
    end

    wire [WINDOW_BITS-1:0] range_weight;
    wire signed [RANGE_BITS-1:0] range_window_re, range_window_im, range_re, range_im;
    dechirp_range_weights range_weights (clk, range_en, sample, range_weight);
    dechirp_window #(SAMPLE_BITS, WINDOW_BITS, RANGE_BITS, RANGE_SHIFT, 1, 0, ROUNDING) range_window (
        clk, range_en, sample_re, sample_im, range_weight, 1'b0, range_window_re, range_window_im
    );
    localparam [31:0] WINDOW_LAG = WINDOW_LATENCY, RANGE_LAG = RANGE_LATENCY;
    wire [EXPONENT_BITS-1:0] range_exponent;
    dechirp_fft #(
        RANGE_BITS, TWIDDLE_BITS, RANGE_INDEX_BITS, 1, SCALING_SHIFT, EXPONENT_BITS, RANGE_LIMITS,
        ROUNDING
    ) range_fft (
        clk, rst, range_en, sample - WINDOW_LAG[RANGE_INDEX_BITS-1:0],
        range_window_re, range_window_im, range_re, range_im, range_exponent
    );

    // The transform leaves in bit-reversed order; the address of the memory turns it round.
    wire [RANGE_INDEX_BITS-1:0] position = sample - RANGE_LAG[RANGE_INDEX_BITS-1:0];
    wire [RANGE_INDEX_BITS-1:0] bin;
    genvar k;
    generate
        for (k = 0; k < RANGE_INDEX_BITS; k = k + 1) begin : bin_bits
            assign bin[k] = position[RANGE_INDEX_BITS-1-k];
        end
    endgenerate
    wire is_kept = {1'b0, bin} <= LAST_ROW_32[RANGE_INDEX_BITS:0];

    reg  [CHANNEL_BITS-1:0] write_channel;
    reg  [CHIRP_ADDRESS_BITS-1:0] write_chirp;
    wire block_written = range_en && range_valid && &position;
    wire last_written_channel = write_channel == LAST_CHANNEL;
    wire last_written_chirp = write_chirp == LAST_CHIRP;
    assign frame_written = block_written && last_written_channel && last_written_chirp;
    always @(posedge clk) begin
        if (rst) begin
            write_channel <= {CHANNEL_BITS{1'b0}};
            write_chirp <= {CHIRP_ADDRESS_BITS{1'b0}};
            write_bank <= 1'b0;
        end else if (block_written) begin
            write_channel <= last_written_channel ? {CHANNEL_BITS{1'b0}} : write_channel + 1'b1;
            if (last_written_channel)
                write_chirp <= last_written_chirp ? {CHIRP_ADDRESS_BITS{1'b0}} : write_chirp + 1'b1;
            if (frame_written) write_bank <= !write_bank;
        end
    end

    localparam CELL_BITS = ADDRESS_BITS - 1;
    localparam ROW_PLACE = CHANNEL_ADDRESS_BITS + CHIRP_ADDRESS_BITS;
    wire [CELL_BITS-1:0] write_cell
        = {{(CELL_BITS - ROW_BITS){1'b0}}, bin[ROW_BITS-1:0]} << ROW_PLACE
        | {{(CELL_BITS - CHANNEL_BITS){1'b0}}, write_channel} << CHIRP_ADDRESS_BITS
        | {{(CELL_BITS - CHIRP_ADDRESS_BITS){1'b0}}, write_chirp};
    assign memory_write_en = range_en && range_valid && is_kept;
    assign memory_write_address = {write_bank, write_cell};
    assign memory_write_data = {range_im, range_re};

    // Exponents of block scaling: one of each chirp and channel, and the largest of the frame.
    localparam PROFILE_BITS = CHANNEL_ADDRESS_BITS + CHIRP_ADDRESS_BITS;
    reg  [EXPONENT_BITS-1:0] largest_written, largest_in_bank_0, largest_in_bank_1;
    wire [EXPONENT_BITS-1:0] largest_with_this
        = range_exponent > largest_written ? range_exponent : largest_written;
    always @(posedge clk) begin
        if (rst) begin
            largest_written <= NO_EXPONENT;
        end else if (block_written) begin
            largest_written <= frame_written ? NO_EXPONENT : largest_with_this;
            if (frame_written && !write_bank) largest_in_bank_0 <= largest_with_this;
            if (frame_written && write_bank) largest_in_bank_1 <= largest_with_this;
        end
    end

    // --- Doppler: window and transform of each range bin ------------------------------------------

    wire [DOPPLER_INDEX_BITS-1:0] turn;
    wire doppler_run, doppler_en, doppler_accept, doppler_valid, doppler_ready;
    dechirp_block_control #(DOPPLER_INDEX_BITS, DOPPLER_LATENCY) doppler_control (
        clk, rst, full[read_bank], 1'b1, memory_read_ready && (!doppler_valid || doppler_ready),
        doppler_run, doppler_en, doppler_accept, turn, doppler_valid
    );

    reg  [ROW_BITS-1:0] read_row;
    reg  [CHANNEL_BITS-1:0] read_channel;
    wire last_read_channel = read_channel == LAST_CHANNEL;
    assign frame_read = doppler_accept && &turn && last_read_channel && read_row == LAST_ROW;
    always @(posedge clk) begin
        if (rst) begin
            read_row <= {ROW_BITS{1'b0}};
            read_channel <= {CHANNEL_BITS{1'b0}};
            read_bank <= 1'b0;
        end else if (doppler_accept && &turn) begin
            read_channel <= last_read_channel ? {CHANNEL_BITS{1'b0}} : read_channel + 1'b1;
            if (last_read_channel) read_row <= frame_read ? {ROW_BITS{1'b0}} : read_row + 1'b1;
            if (frame_read) read_bank <= !read_bank;
        end
    end

    // Chirps enter in bit-reversed order, so that velocities leave in natural order.
    wire [DOPPLER_INDEX_BITS-1:0] chirp;
    generate
        for (k = 0; k < DOPPLER_INDEX_BITS; k = k + 1) begin : chirp_bits
            assign chirp[k] = turn[DOPPLER_INDEX_BITS-1-k];
        end
    endgenerate
    wire is_chirp = {1'b0, chirp} < N_CHIRPS_32[DOPPLER_INDEX_BITS:0];  // else zero padding
    wire [CELL_BITS-1:0] read_cell
        = {{(CELL_BITS - ROW_BITS){1'b0}}, read_row} << ROW_PLACE
        | {{(CELL_BITS - CHANNEL_BITS){1'b0}}, read_channel} << CHIRP_ADDRESS_BITS
        | {{(CELL_BITS - CHIRP_ADDRESS_BITS){1'b0}}, chirp[CHIRP_ADDRESS_BITS-1:0]};
    assign memory_read_en = doppler_en;
    assign memory_read_address = {read_bank, read_cell};
    reg  has_word;
    always @(posedge clk) if (doppler_en) has_word <= doppler_accept && is_chirp;
    wire [2*RANGE_BITS-1:0] word = has_word ? memory_read_data : {2 * RANGE_BITS{1'b0}};
    wire signed [RANGE_BITS-1:0] word_re = word[RANGE_BITS-1:0];
    wire signed [RANGE_BITS-1:0] word_im = word[2*RANGE_BITS-1:RANGE_BITS];

    // Bits by which a word is shifted to the largest exponent of its frame.
    wire [EXPONENT_BITS-1:0] alignment;
    generate
        if (BLOCK_SCALING) begin : range_exponents
            wire [EXPONENT_BITS-1:0] exponent;
            reg  [EXPONENT_BITS-1:0] largest;
            dechirp_ram #(EXPONENT_BITS, 2 << PROFILE_BITS, 1 + PROFILE_BITS) exponents (
                clk, block_written, {write_bank, write_cell[PROFILE_BITS-1:0]}, range_exponent,
                doppler_en, {read_bank, read_cell[PROFILE_BITS-1:0]}, exponent
            );
            always @(posedge clk)
                if (doppler_en) largest <= read_bank ? largest_in_bank_1 : largest_in_bank_0;
            assign alignment = has_word ? largest - exponent : NO_EXPONENT;
        end else begin : one_exponent
            wire unused_exponents = &{1'b0, largest_in_bank_0, largest_in_bank_1};
            assign alignment = NO_EXPONENT;
        end
    endgenerate

    wire [WINDOW_BITS-1:0] doppler_weight;
    wire signed [DOPPLER_BITS-1:0] doppler_window_re, doppler_window_im, doppler_re, doppler_im;
    dechirp_doppler_weights doppler_weights (clk, doppler_en, chirp, doppler_weight);
    dechirp_window #(
        RANGE_BITS, WINDOW_BITS, DOPPLER_BITS, DOPPLER_SHIFT, EXPONENT_BITS,
        BLOCK_SCALING ? MAX_RANGE_EXPONENT : 0, ROUNDING
    ) doppler_window (
        clk, doppler_en, word_re, word_im, doppler_weight, alignment,
        doppler_window_re, doppler_window_im
    );
    wire [EXPONENT_BITS-1:0] doppler_exponent;
    dechirp_fft #(
        DOPPLER_BITS, TWIDDLE_BITS, DOPPLER_INDEX_BITS, 0, SCALING_SHIFT, EXPONENT_BITS,
        DOPPLER_LIMITS, ROUNDING
    ) doppler_fft (
        clk, rst, doppler_en, turn - WINDOW_LAG[DOPPLER_INDEX_BITS-1:0],
        doppler_window_re, doppler_window_im, doppler_re, doppler_im, doppler_exponent
    );

    wire doppler_moves = doppler_run && memory_read_ready && doppler_valid;  // if it is ready

    // --- Power ------------------------------------------------------------------------------------

    // Words for the power, with the bits by which their exponent is below that of the frame.
    wire power_run, power_en, word_valid;  // the memory has its word; a step; the word is real
    wire signed [DOPPLER_BITS-1:0] spectrum_re, spectrum_im;
    wire [EXPONENT_BITS-1:0] power_alignment;
    generate
        if (BLOCK_SCALING) begin : block_exponent
            wire write_ready, read_valid;
            reg  was_read;
            assign doppler_ready = write_ready && spectrum_write_ready;
            assign spectrum_write_en = doppler_moves && doppler_ready;
            assign spectrum_write_data = {doppler_im, doppler_re};
            assign power_run = spectrum_read_ready;
            assign spectrum_read_en = power_en && read_valid;
            dechirp_spectrum_buffer #(
                N_ROWS * N_CHANNELS, DOPPLER_INDEX_BITS, TRANSFORM_BITS, EXPONENT_BITS
            ) spectrum_buffer (
                clk, rst, spectrum_write_en, write_ready, doppler_exponent, spectrum_write_address,
                power_en, read_valid, spectrum_read_address, power_alignment
            );
            always @(posedge clk) begin
                if (rst) was_read <= 1'b0;
                else if (power_en) was_read <= read_valid;
            end
            assign word_valid = was_read;
            assign {spectrum_im, spectrum_re} = spectrum_read_data;
        end else begin : no_exponent
            wire unused = &{1'b0, doppler_exponent, spectrum_write_ready, spectrum_read_ready,
                spectrum_read_data};
            assign doppler_ready = power_en;
            assign power_run = 1'b1;
            assign word_valid = doppler_moves;
            assign spectrum_re = doppler_re;
            assign spectrum_im = doppler_im;
            assign power_alignment = NO_EXPONENT;
            assign spectrum_write_en = 1'b0;
            assign spectrum_write_address = {SPECTRUM_ADDRESS_BITS{1'b0}};
            assign spectrum_write_data = {2 * DOPPLER_BITS{1'b0}};
            assign spectrum_read_en = 1'b0;
            assign spectrum_read_address = {SPECTRUM_ADDRESS_BITS{1'b0}};
        end
    endgenerate

    wire [POWER_BITS-1:0] power;
    dechirp_power #(
        DOPPLER_BITS, EXPONENT_BITS, BLOCK_SCALING ? MAX_DOPPLER_EXPONENT : 0, POWER_SHIFT,
        POWER_BITS, ROUNDING
    ) power_of_word (clk, power_en, spectrum_re, spectrum_im, power_alignment, power);
    reg  [POWER_LATENCY-1:0] in_power;  // words on their way
    wire power_of_word_valid = in_power[POWER_LATENCY-1];
    always @(posedge clk) begin
        if (rst) in_power <= {POWER_LATENCY{1'b0}};
        else if (power_en) in_power <= {in_power[POWER_LATENCY-2:0], word_valid};
    end

    // Channel and range bin of the power.
    reg  [CHANNEL_BITS-1:0] power_channel;
    reg  [ROW_BITS-1:0] power_row;
    reg  [DOPPLER_INDEX_BITS-1:0] velocity;
    reg  is_searched;
    wire cell_valid, cell_ready;
    wire last_power_channel = power_channel == LAST_CHANNEL;
    wire [ROW_BITS-1:0] next_power_row
        = power_row == LAST_ROW ? {ROW_BITS{1'b0}} : power_row + 1'b1;
    wire [ROW_BITS:0] searched_row = {1'b0, next_power_row} - FIRST_SEARCHED_32[ROW_BITS:0];
    assign power_en = power_run && (!cell_valid || cell_ready);
    always @(posedge clk) begin
        if (rst) begin
            power_channel <= {CHANNEL_BITS{1'b0}};
            power_row <= {ROW_BITS{1'b0}};
            velocity <= {DOPPLER_INDEX_BITS{1'b0}};
            is_searched <= FIRST_SEARCHED == 0;
        end else if (power_en && power_of_word_valid) begin
            velocity <= velocity + 1'b1;
            if (&velocity) begin
                power_channel <= last_power_channel ? {CHANNEL_BITS{1'b0}} : power_channel + 1'b1;
                if (last_power_channel) begin
                    power_row <= next_power_row;
                    is_searched <= searched_row <= LAST_SEARCHED_32[ROW_BITS:0];
                end
            end
        end
    end

    // Sum over channels: the sum of the channels before comes back after one transform.
    wire [POWER_BITS-1:0] total_power;
    generate
        if (N_CHANNELS == 1) begin : one_channel
            assign total_power = power;
        end else begin : several_channels
            wire [POWER_BITS-1:0] sum_before;
            dechirp_delay_line #(POWER_BITS, 1 << DOPPLER_INDEX_BITS)
                sums (clk, rst, power_en && power_of_word_valid, total_power, sum_before);
            assign total_power = power
                + (power_channel == {CHANNEL_BITS{1'b0}} ? {POWER_BITS{1'b0}} : sum_before);
        end
    endgenerate
    assign cell_valid = power_of_word_valid && last_power_channel && is_searched;

    // --- Detector -----------------------------------------------------------------------------------

    // The register slice separates the enables of the power and of the detector.
    wire power_valid, power_ready;
    wire [POWER_BITS-1:0] searched_power;
    dechirp_skid_buffer #(POWER_BITS) power_slice (
        clk, rst, cell_valid && power_run, cell_ready, total_power,
        power_valid, power_ready, searched_power
    );
    wire [SEARCHED_BITS-1:0] factor_row, out_row;
    wire factor_en, out_detected;
    wire [FACTOR_BITS-1:0] factor;
    wire [POWER_BITS-1:0] out_power, out_threshold;
    wire [DOPPLER_INDEX_BITS-1:0] out_velocity;
    dechirp_factors factors (clk, factor_en, factor_row, factor);
    dechirp_cfar #(
        .POWER_BITS(POWER_BITS),
        .N_ROWS(N_SEARCHED),
        .VELOCITY_BITS(DOPPLER_INDEX_BITS),
        .ROW_BITS(SEARCHED_BITS),
        .HALF_RANGE(HALF_RANGE),
        .HALF_VELOCITY(HALF_VELOCITY),
        .GUARD_RANGE(GUARD_RANGE),
        .GUARD_VELOCITY(GUARD_VELOCITY),
        .FACTOR_BITS(FACTOR_BITS),
        .FACTOR_SHIFT(FACTOR_SHIFT)
    ) cfar (
        .clk(clk),
        .rst(rst),
        .in_valid(power_valid),
        .in_ready(power_ready),
        .in_power(searched_power),
        .factor_address(factor_row),
        .factor_en(factor_en),
        .factor(factor),
        .out_valid(m_axis_tvalid),
        .out_ready(m_axis_tready),
        .out_power(out_power),
        .out_threshold(out_threshold),
        .out_detected(out_detected),
        .out_row(out_row),
        .out_velocity(out_velocity)
    );
    wire [RANGE_INDEX_BITS:0] out_bin
        = {{(RANGE_INDEX_BITS + 1 - SEARCHED_BITS){1'b0}}, out_row} + FIRST_SEARCHED_32[RANGE_INDEX_BITS:0];
    wire unused_carry = out_bin[RANGE_INDEX_BITS];
    assign m_axis_tdata = {out_detected, out_threshold, out_power};
    assign m_axis_tuser = {out_bin[RANGE_INDEX_BITS-1:0], out_velocity};
    assign m_axis_tlast = out_row == LAST_SEARCHED_32[SEARCHED_BITS-1:0] && &out_velocity;
endmodule
