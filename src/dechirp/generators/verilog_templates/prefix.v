// {{ banner }}
//
// Range-Doppler chain of {{ n_samples }} samples, {{ n_channels }} channel{{ "s" if n_channels > 1 }} and {{ n_chirps }} chirps, with its memory in block
// RAM: {{ 2 * bank_words }} words of {{ 2 * range_bits }} bits for the corner turn{% if spectrum_words %}, {{ spectrum_words }} words of {{ 2 * doppler_bits }} bits for spectra{% endif %}.
// Where that is too much, use {{ name }}_core with memories of your own.
module {{ name }} (
    input  wire         clk,
    input  wire         rst,            // synchronous
    // One sample: {{ "bits %d to 0 are I, bits %d to %d are Q" | format(sample_bits - 1, 2 * sample_bits - 1, sample_bits) if is_complex else "a real number" }}, two's complement.
    input  wire         s_axis_tvalid,
    output wire         s_axis_tready,
    input  wire [{{ sample_stream_bits - 1 }}:0] s_axis_tdata,
    // One cell: bits {{ power_bits - 1 }} to 0 are its power, bits {{ 2 * power_bits - 1 }} to {{ power_bits }} its threshold, bit {{ 2 * power_bits }} is 1
    // where the power exceeds the threshold.
    output wire         m_axis_tvalid,
    input  wire         m_axis_tready,
    output wire [{{ cell_stream_bits - 1 }}:0] m_axis_tdata,
    // Its velocity bin in bits {{ velocity_bits - 1 }} to 0, its range bin in bits {{ user_bits - 1 }} to {{ velocity_bits }}.
    output wire [{{ user_stream_bits - 1 }}:0] m_axis_tuser,
    output wire         m_axis_tlast    // the last cell of a frame
);
    wire write_en, read_en;
    wire [{{ address_bits - 1 }}:0] write_address, read_address;
    wire [{{ 2 * range_bits - 1 }}:0] write_data, read_data;
    wire spectrum_write_en, spectrum_read_en;
    wire [{{ spectrum_address_bits - 1 }}:0] spectrum_write_address, spectrum_read_address;
    wire [{{ 2 * doppler_bits - 1 }}:0] spectrum_write_data, spectrum_read_data;
    wire cell_valid, cell_ready, cell_last;
    wire [{{ 2 * power_bits }}:0] cell_data;
    wire [{{ user_bits - 1 }}:0] cell_user;

    {{ name }}_core #(
{% for parameter, number in parameters.items() %}
        .{{ parameter }}({{ number }}),
{% endfor %}
        .RANGE_LIMITS({{ range_limits }}),
        .DOPPLER_LIMITS({{ doppler_limits }})
    ) core (
        .clk(clk),
        .rst(rst),
        .s_axis_tvalid(s_axis_tvalid),
        .s_axis_tready(s_axis_tready),
        .s_axis_tdata(s_axis_tdata[{{ data_in_bits - 1 }}:0]),
        .m_axis_tvalid(cell_valid),
        .m_axis_tready(cell_ready),
        .m_axis_tdata(cell_data),
        .m_axis_tuser(cell_user),
        .m_axis_tlast(cell_last),
{% for memory, wires in (("memory", ""), ("spectrum", "spectrum_")) %}
        .{{ memory }}_write_en({{ wires }}write_en),
        .{{ memory }}_write_ready(1'b1),
        .{{ memory }}_write_address({{ wires }}write_address),
        .{{ memory }}_write_data({{ wires }}write_data),
        .{{ memory }}_read_en({{ wires }}read_en),
        .{{ memory }}_read_ready(1'b1),
        .{{ memory }}_read_address({{ wires }}read_address),
        .{{ memory }}_read_data({{ wires }}read_data){{ "," if not loop.last }}
{% endfor %}
    );

    {{ name }}_corner_memory #({{ 2 * range_bits }}, {{ bank_words }}, {{ address_bits }}) corner_memory (
        clk, write_en, write_address, write_data, read_en, read_address, read_data
    );

{% if spectrum_words %}
    {{ name }}_ram #({{ 2 * doppler_bits }}, {{ spectrum_words }}, {{ spectrum_address_bits }}) spectrum_memory (
        clk, spectrum_write_en, spectrum_write_address, spectrum_write_data,
        spectrum_read_en, spectrum_read_address, spectrum_read_data
    );
{% else %}
    assign spectrum_read_data = {{ 2 * doppler_bits }}'d0;
    wire unused_spectrum = &{1'b0, spectrum_write_en, spectrum_write_address, spectrum_write_data,
        spectrum_read_en, spectrum_read_address};
{% endif %}

    {{ name }}_skid_buffer #({{ 2 * power_bits + user_bits + 2 }}) output_slice (
        clk, rst, cell_valid, cell_ready, {cell_last, cell_user, cell_data},
        m_axis_tvalid, m_axis_tready,
        {m_axis_tlast, m_axis_tuser[{{ user_bits - 1 }}:0], m_axis_tdata[{{ 2 * power_bits }}:0]}
    );

    // AXI4-Stream transports whole bytes. Bits beyond the words are 0, and not read.
{% if sample_stream_bits > data_in_bits %}
    wire unused_bits = &{1'b0, s_axis_tdata[{{ sample_stream_bits - 1 }}:{{ data_in_bits }}]};
{% endif %}
{% if user_stream_bits > user_bits %}
    assign m_axis_tuser[{{ user_stream_bits - 1 }}:{{ user_bits }}] = {{ user_stream_bits - user_bits }}'d0;
{% endif %}
    assign m_axis_tdata[{{ cell_stream_bits - 1 }}:{{ 2 * power_bits + 1 }}] = {{ cell_stream_bits - 2 * power_bits - 1 }}'d0;
endmodule
