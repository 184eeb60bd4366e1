// Delay words by DEPTH enabled clocks: a wire, registers, or a circular buffer in memory.
module dechirp_delay_line #(
    parameter BITS = 32,
    parameter DEPTH = 64
) (
    input  wire            clk,
    input  wire            rst,
    input  wire            en,
    input  wire [BITS-1:0] in,
    output wire [BITS-1:0] out
);
    generate
        if (DEPTH == 0) begin : through
            wire unused = &{1'b0, clk, rst, en};
            assign out = in;
        end else if (DEPTH == 1) begin : single
            reg [BITS-1:0] word;
            wire unused = &{1'b0, rst};
            assign out = word;
            always @(posedge clk) if (en) word <= in;
        end else if (DEPTH <= 4) begin : registers
            reg [DEPTH*BITS-1:0] words;
            wire unused = &{1'b0, rst};
            assign out = words[DEPTH*BITS-1 -: BITS];
            always @(posedge clk) if (en) words <= {words[(DEPTH-1)*BITS-1:0], in};
        end else begin : buffer
            // The last clock is a register, as reading a block RAM takes long.
            localparam ADDRESS_BITS = $clog2(DEPTH - 1);
            localparam [31:0] LAST = DEPTH - 2;
            reg [BITS-1:0] words [0:DEPTH-2];
            reg [BITS-1:0] word, last_word;
            reg [ADDRESS_BITS-1:0] address;
            wire at_last = address == LAST[ADDRESS_BITS-1:0];
            wire [ADDRESS_BITS-1:0] next = at_last ? {ADDRESS_BITS{1'b0}} : address + 1'b1;
            assign out = last_word;
            always @(posedge clk) begin
                if (en) begin
                    words[address] <= in;
                    word <= words[next];  // written DEPTH - 2 clocks ago
                    last_word <= word;
                end
            end
            always @(posedge clk) begin
                if (rst) address <= {ADDRESS_BITS{1'b0}};
                else if (en) address <= next;
            end
        end
    endgenerate
endmodule
