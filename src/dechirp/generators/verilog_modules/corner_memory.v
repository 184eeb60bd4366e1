// Corner-turn memory in block RAM: two banks of one frame each. The highest bit of an address
// selects the bank.
module dechirp_corner_memory #(
    parameter BITS = 32,
    parameter DEPTH = 16384,  // words of a bank
    parameter ADDRESS_BITS = 15
) (
    input  wire                    clk,
    input  wire                    write_en,
    input  wire [ADDRESS_BITS-1:0] write_address,
    input  wire [BITS-1:0]         write_data,
    input  wire                    read_en,
    input  wire [ADDRESS_BITS-1:0] read_address,
    output wire [BITS-1:0]         read_data
);
    wire write_bank = write_address[ADDRESS_BITS-1];
    wire read_bank = read_address[ADDRESS_BITS-1];
    wire [BITS-1:0] data_0, data_1;
    reg  bank;
    dechirp_ram #(BITS, DEPTH, ADDRESS_BITS - 1)
        bank_0 (clk, write_en && !write_bank, write_address[ADDRESS_BITS-2:0], write_data,
            read_en, read_address[ADDRESS_BITS-2:0], data_0),
        bank_1 (clk, write_en && write_bank, write_address[ADDRESS_BITS-2:0], write_data,
            read_en, read_address[ADDRESS_BITS-2:0], data_1);
    always @(posedge clk) if (read_en) bank <= read_bank;
    assign read_data = bank ? data_1 : data_0;
endmodule
