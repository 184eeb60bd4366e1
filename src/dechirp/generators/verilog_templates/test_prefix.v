// {{ banner }}
//
// Self-checking test bench: frames of test vectors in, every word out compared.
//
// Plus arguments: +vectors=FOLDER, +frames=N repeats the frame, +stall=PERCENT holds both ends back
// at random, +seed=N starts the random numbers. A file of vectors that is missing or of another
// length, and any wrong word, end the simulation with a status other than 0.
`timescale 1ns / 1ps
module test_{{ name }};
{% for parameter, number in parameters.items() %}
    localparam {{ parameter }} = {{ number }};
{% endfor %}
    localparam N_WORDS = N_CHIRPS * N_CHANNELS * N_SAMPLES;
    localparam N_VELOCITY = 1 << DOPPLER_INDEX_BITS;
    localparam N_PROFILES = N_CHIRPS * N_CHANNELS * N_ROWS;
    localparam N_SPECTRA = N_CHANNELS * N_ROWS * N_VELOCITY;
    localparam N_CELLS = N_VELOCITY * N_ROWS;
    localparam MAX_IDLE = 16 * (N_WORDS + N_CELLS) + 1000000;  // clocks
    localparam MAX_SHOWN = 10;

    reg [8*256-1:0] folder, name;
    integer n_frames, stall, seed;
    integer file, n_read, errors = 0;
    reg [63:0] word_of_file;

    reg signed [SAMPLE_BITS-1:0] samples_i [0:N_WORDS-1];
    reg signed [SAMPLE_BITS-1:0] samples_q [0:N_WORDS-1];
    reg signed [RANGE_BITS-1:0] range_i [0:N_PROFILES-1];
    reg signed [RANGE_BITS-1:0] range_q [0:N_PROFILES-1];
    reg signed [DOPPLER_BITS-1:0] doppler_i [0:N_SPECTRA-1];
    reg signed [DOPPLER_BITS-1:0] doppler_q [0:N_SPECTRA-1];
    reg [POWER_BITS-1:0] power [0:N_CELLS-1];
    reg [POWER_BITS-1:0] threshold [0:N_CELLS-1];
    reg detected [0:N_CELLS-1];

    reg clk = 1'b0;
    reg rst = 1'b1;
    always #5 clk = !clk;

    reg in_valid = 1'b0;
    wire in_ready;
    wire [{{ sample_stream_bits - 1 }}:0] in_data;
    wire out_valid, out_last;
    reg out_ready = 1'b0;
    wire [{{ cell_stream_bits - 1 }}:0] out_data;
    wire [{{ user_stream_bits - 1 }}:0] out_user;

    integer next_sample = 0;
    generate
        if (COMPLEX_SAMPLES) begin : complex_samples
            assign in_data = {samples_q[next_sample], samples_i[next_sample]};
        end else begin : real_samples
            assign in_data = samples_i[next_sample];
        end
    endgenerate

    {{ name }} dut (
        .clk(clk),
        .rst(rst),
        .s_axis_tvalid(in_valid),
        .s_axis_tready(in_ready),
        .s_axis_tdata(in_data),
        .m_axis_tvalid(out_valid),
        .m_axis_tready(out_ready),
        .m_axis_tdata(out_data),
        .m_axis_tuser(out_user),
        .m_axis_tlast(out_last)
    );

    // Icarus Verilog ends $stop with a prompt, so it has a task of its own for the status.
    task end_with_failure;
        begin
            $display("FAIL: %0d errors", errors);
`ifdef __ICARUS__
            $finish_and_return(1);
`else
            $stop;
`endif
        end
    endtask

    // Set `name` to the path of a file of vectors, and check that it has `n_words` words.
    task check_file(input [8*16-1:0] stage, input integer n_words);
        begin
            $sformat(name, "%0s/%0s.hex", folder, stage);
            file = $fopen(name, "r");
            n_read = 0;
            if (file != 0) begin
                while ($fscanf(file, "%h", word_of_file) == 1) n_read = n_read + 1;
                $fclose(file);
            end
            if (n_read != n_words) begin
                errors = errors + 1;
                $display("%0s: %0d words, expected %0d; write it with dechirp fixed-point for the same settings",
                    name, n_read, n_words);
                end_with_failure;
            end
        end
    endtask

    initial begin
        if (!$value$plusargs("vectors=%s", folder)) folder = "vectors";
        if (!$value$plusargs("frames=%d", n_frames)) n_frames = 1;
        if (!$value$plusargs("stall=%d", stall)) stall = 0;
        if (!$value$plusargs("seed=%d", seed)) seed = 1;
        if (COMPLEX_SAMPLES) begin
            check_file("samples_i", N_WORDS);
            $readmemh(name, samples_i);
            check_file("samples_q", N_WORDS);
            $readmemh(name, samples_q);
        end else begin
            check_file("samples", N_WORDS);
            $readmemh(name, samples_i);
        end
        check_file("range_fft_i", N_PROFILES);
        $readmemh(name, range_i);
        check_file("range_fft_q", N_PROFILES);
        $readmemh(name, range_q);
        check_file("doppler_fft_i", N_SPECTRA);
        $readmemh(name, doppler_i);
        check_file("doppler_fft_q", N_SPECTRA);
        $readmemh(name, doppler_q);
        check_file("power", N_CELLS);
        $readmemh(name, power);
        check_file("threshold", N_CELLS);
        $readmemh(name, threshold);
        check_file("detected", N_CELLS);
        $readmemh(name, detected);
        $display("velocity_bin range_bin power threshold");
        repeat (4) @(negedge clk);
        rst = 1'b0;
    end

    integer clocks = 0, idle = 0, first_clock = 0, last_clock = 0;
    integer frames_in = 0, frames_out = 0, cells = 0, detections = 0;
    integer range_words = 0, doppler_words = 0;

    // A new offer on either side only after the last was taken, as AXI4-Stream requires.
    reg in_taken = 1'b1;
    always @(negedge clk) begin
        if (!rst) begin
            if (in_taken || !in_valid)
                in_valid = frames_in < n_frames && $unsigned($random(seed)) % 100 >= stall;
            out_ready = $unsigned($random(seed)) % 100 >= stall;
        end
    end

    // Words of the two transforms, inside.
    wire [RANGE_INDEX_BITS-1:0] bin = dut.core.bin;
    integer place, row, channel, cell_place;
    always @(posedge clk) begin
        if (!rst && dut.core.memory_write_en && dut.core.memory_write_ready) begin
            place = (dut.core.write_chirp * N_CHANNELS + dut.core.write_channel) * N_ROWS + bin;
            range_words = range_words + 1;
            if (dut.core.range_re !== range_i[place] || dut.core.range_im !== range_q[place]) begin
                errors = errors + 1;
                if (errors <= MAX_SHOWN)
                    $display("range_fft: word %0d is %0d + %0d i, the model has %0d + %0d i", place,
                        dut.core.range_re, dut.core.range_im, range_i[place], range_q[place]);
            end
        end
        // Range bin by range bin, channel by channel within one.
        if (!rst && dut.core.doppler_en && dut.core.doppler_valid) begin
            row = doppler_words / (N_CHANNELS * N_VELOCITY) % N_ROWS;
            channel = doppler_words / N_VELOCITY % N_CHANNELS;
            place = (channel * N_ROWS + row) * N_VELOCITY + doppler_words % N_VELOCITY;
            doppler_words = doppler_words + 1;
            if (dut.core.doppler_re !== doppler_i[place] || dut.core.doppler_im !== doppler_q[place])
            begin
                errors = errors + 1;
                if (errors <= MAX_SHOWN)
                    $display("doppler_fft: word %0d is %0d + %0d i, the model has %0d + %0d i", place,
                        dut.core.doppler_re, dut.core.doppler_im, doppler_i[place], doppler_q[place]);
            end
        end
    end

    // Both ends.
    always @(posedge clk) begin
        clocks <= clocks + 1;
        idle <= idle + 1;
        in_taken <= in_valid && in_ready;
        if (!rst && in_valid && in_ready) begin
            idle <= 0;
            if (frames_in == 0 && next_sample == 0) first_clock <= clocks;
            last_clock <= clocks;
            next_sample <= next_sample == N_WORDS - 1 ? 0 : next_sample + 1;
            if (next_sample == N_WORDS - 1) frames_in <= frames_in + 1;
        end
        if (!rst && out_valid && out_ready) begin
            idle <= 0;
            cell_place = out_user[DOPPLER_INDEX_BITS-1:0] * N_ROWS
                + out_user[RANGE_INDEX_BITS+DOPPLER_INDEX_BITS-1:DOPPLER_INDEX_BITS];
            cells = cells + 1;
            if (out_data !== {detected[cell_place], threshold[cell_place], power[cell_place]}) begin
                errors = errors + 1;
                if (errors <= MAX_SHOWN)
                    $display("cell %0d: power %0d, threshold %0d; the model has %0d, %0d", cell_place,
                        out_data[POWER_BITS-1:0], out_data[2*POWER_BITS-1:POWER_BITS],
                        power[cell_place], threshold[cell_place]);
            end
            if (out_data[2*POWER_BITS]) begin
                detections = detections + 1;
                if (frames_out == 0)
                    $display("%0d %0d %0d %0d", cell_place / N_ROWS, cell_place % N_ROWS,
                        out_data[POWER_BITS-1:0], out_data[2*POWER_BITS-1:POWER_BITS]);
            end
            if (out_last) frames_out = frames_out + 1;
        end
        if ((frames_out == n_frames && doppler_words >= n_frames * N_SPECTRA) || idle > MAX_IDLE)
        begin
            if (cells != n_frames * N_VELOCITY * N_SEARCHED
                || range_words != n_frames * N_PROFILES
                || doppler_words != n_frames * N_SPECTRA) begin
                errors = errors + 1;
                $display("%0d words of range_fft, %0d of doppler_fft, %0d cells in %0d frames",
                    range_words, doppler_words, cells, frames_out);
            end
            $display("%0d frames, %0d cells, %0d detections; %0d clocks for %0d samples", frames_out,
                cells, detections, last_clock - first_clock + 1, frames_in * N_WORDS);
            if (errors == 0) $display("PASS: every word equals the model");
            else end_with_failure;
            $finish;
        end
    end
endmodule
