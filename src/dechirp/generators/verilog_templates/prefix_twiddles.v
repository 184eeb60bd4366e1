// {{ banner }}
//
// Twiddle factors exp(-2 pi i k / 2^STAGE) of a stage of both transforms, k < 2^(STAGE - 1):
// imaginary, then real part, {{ bits // 2 - 2 }} bits behind the point. The word of an address appears one
// enabled clock later.
module {{ name }}_twiddles #(
    parameter STAGE = 3
) (
    input  wire             clk,
    input  wire             en,
    input  wire [STAGE-2:0] address,
    output reg  [{{ bits - 1 }}:0] word
);
    generate
{% for stage, words in stages.items() %}
        {{ "else " if not loop.first }}if (STAGE == {{ stage }}) begin : stage_{{ stage }}
            always @(posedge clk) begin
                if (en) begin
                    case (address)
{% for number in words %}
                        {{ stage - 1 }}'d{{ loop.index0 }}: word <= {{ bits }}'h{{ "%0*x" | format(digits, number) }};
{% endfor %}
                        default: word <= {{ bits }}'d0;
                    endcase
                end
            end
        end
{% endfor %}
    endgenerate
endmodule
