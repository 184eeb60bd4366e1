// {{ banner }}
//
// Twiddle factors after a pair of stages of m = 2^BITS points, in both transforms, by position:
// exp(-2 pi i e / m), e = 0, 2 k, k and 3 k in the four quarters, k < m / 4; imaginary, then real part,
// {{ bits // 2 - 2 }} bits behind the point. The word of an address appears one enabled clock later.
module {{ name }}_twiddles #(
    parameter BITS = 3
) (
    input  wire             clk,
    input  wire             en,
    input  wire [BITS-1:0] address,
    output reg  [{{ bits - 1 }}:0] word
);
    generate
{% for address_bits, words in pairs.items() %}
        {{ "else " if not loop.first }}if (BITS == {{ address_bits }}) begin : bits_{{ address_bits }}
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
        end
{% endfor %}
    endgenerate
endmodule
