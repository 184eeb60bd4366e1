// {{ banner }}
//
// {{ help }} The word of an address appears one enabled clock later.
module {{ name }}_{{ table }} (
    input  wire       clk,
    input  wire       en,
    input  wire [{{ address_bits - 1 }}:0] address,
    output reg  [{{ bits - 1 }}:0] word
);
    always @(posedge clk) begin
        if (en) begin
            case (address)
{% for number in words %}
                {{ address_bits }}'d{{ loop.index0 }}: word <= {{ bits }}'h{{ "%0*x" | format(digits, number) }};
{% endfor %}
                default: word <= {{ bits }}'d0;
            endcase
        end
    end
endmodule
