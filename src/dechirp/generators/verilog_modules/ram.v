// Memory with a write port and a registered read port.
module dechirp_ram #(
    parameter BITS = 32,
    parameter DEPTH = 128,
    parameter ADDRESS_BITS = 7
) (
    input  wire                    clk,
    input  wire                    write_en,
    input  wire [ADDRESS_BITS-1:0] write_address,
    input  wire [BITS-1:0]         write_data,
    input  wire                    read_en,
    input  wire [ADDRESS_BITS-1:0] read_address,
    output reg  [BITS-1:0]         read_data
);
    reg [BITS-1:0] words [0:DEPTH-1];
    always @(posedge clk) begin
        if (write_en) words[write_address] <= write_data;
        if (read_en) read_data <= words[read_address];
    end
endmodule
