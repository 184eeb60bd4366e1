// Hold the words of one frame of transforms back until their largest exponent is known.
//
// One word a clock enters and leaves: a word of the next frame takes the place of the same word of
// the frame before, as soon as that one has left. Each word leaves with the bits by which its
// exponent is below the largest one of its frame, one enabled clock after its read.
//
// The memory is outside. It returns the word of an address one clock after the enabled read.
module dechirp_spectrum_buffer #(
    parameter N_TRANSFORMS = 256,   // of a frame
    parameter INDEX_BITS = 6,       // log2 of the words of a transform
    parameter TRANSFORM_BITS = 8,
    parameter EXPONENT_BITS = 5,
    parameter ADDRESS_BITS = TRANSFORM_BITS + INDEX_BITS
) (
    input  wire                     clk,
    input  wire                     rst,
    input  wire                     write_en,       // only while `write_ready` is 1
    output reg                      write_ready,
    input  wire [EXPONENT_BITS-1:0] write_exponent,
    output reg  [ADDRESS_BITS-1:0]  write_address,
    input  wire                     read_en,
    output reg                      read_valid,     // the word at `read_address` is there
    output reg  [ADDRESS_BITS-1:0]  read_address,
    output wire [EXPONENT_BITS-1:0] below_largest   // of the word read in the enabled clock before
);
    localparam [31:0] LAST_32 = (N_TRANSFORMS << INDEX_BITS) - 1;
    localparam [ADDRESS_BITS-1:0] FIRST = 0, LAST = LAST_32[ADDRESS_BITS-1:0];

    wire ends_write = write_en && write_address == LAST;
    wire ends_read = read_en && read_valid && read_address == LAST;
    wire is_apart = write_address != read_address && write_address + 1'b1 != read_address;
    always @(posedge clk) begin
        if (rst) begin
            write_address <= FIRST;
            read_address <= FIRST;
            read_valid <= 1'b0;
            write_ready <= 1'b0;
        end else begin
            if (write_en) write_address <= ends_write ? FIRST : write_address + 1'b1;
            if (read_en && read_valid) read_address <= ends_read ? FIRST : read_address + 1'b1;
            if (ends_write) read_valid <= 1'b1;
            else if (ends_read) read_valid <= 1'b0;
            write_ready <= read_valid ? is_apart : !ends_write;
        end
    end

    reg  [EXPONENT_BITS-1:0] largest_written, largest_of_frame, largest;
    wire [EXPONENT_BITS-1:0] exponent;
    wire [EXPONENT_BITS-1:0] largest_with_this
        = write_address == FIRST || write_exponent > largest_written
        ? write_exponent : largest_written;
    always @(posedge clk) begin
        if (write_en) largest_written <= largest_with_this;
        if (ends_write) largest_of_frame <= largest_with_this;
        if (read_en) largest <= largest_of_frame;
    end
    dechirp_ram #(EXPONENT_BITS, N_TRANSFORMS, TRANSFORM_BITS) exponents (
        clk, write_en && &write_address[INDEX_BITS-1:0],  // its words before have been read
        write_address[ADDRESS_BITS-1:INDEX_BITS], write_exponent,
        read_en, read_address[ADDRESS_BITS-1:INDEX_BITS], exponent
    );
    assign below_largest = largest - exponent;
endmodule
