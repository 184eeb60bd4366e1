// Control of a pipeline of fixed latency whose blocks (transforms) have POINTS words.
//
// The pipeline moves in steps, one word each, while `en` is 1. Between frames it stops; blocks
// without data push the last real ones out. Output words are valid as long as `out_valid` is 1.
module dechirp_block_control #(
    parameter INDEX_BITS = 8,
    parameter LATENCY = 300  // at least one block
) (
    input  wire                  clk,
    input  wire                  rst,
    input  wire                  available,  // data for the word at `index` are there
    input  wire                  may_flush,  // the block at `index` 0 would be the first of a frame
    input  wire                  ready,      // the output can take its word
    output wire                  run,        // a step is possible as far as the input is concerned
    output wire                  en,
    output wire                  accept,     // the word of this step is real
    output reg  [INDEX_BITS-1:0] index,      // position in the block of the word of this step
    output reg                   out_valid
);
    localparam [31:0] WHOLE_BLOCKS = LATENCY >> INDEX_BITS;
    localparam [31:0] LAG = LATENCY;
    localparam [INDEX_BITS-1:0] REST = LAG[INDEX_BITS-1:0];

    reg  is_flush;
    reg  [WHOLE_BLOCKS:0] earlier;  // real blocks before this one, the latest in bit 0
    wire at_start = index == {INDEX_BITS{1'b0}};
    wire is_real = at_start ? available : !is_flush;
    wire [INDEX_BITS-1:0] next_index = index + 1'b1;
    wire [WHOLE_BLOCKS:0] next_earlier = &index ? {earlier[WHOLE_BLOCKS-1:0], is_real} : earlier;

    assign run = available || (at_start ? may_flush && |earlier : is_flush);
    assign en = run && ready;
    assign accept = en && is_real;

    always @(posedge clk) begin
        if (rst) begin
            index <= {INDEX_BITS{1'b0}};
            is_flush <= 1'b0;
            earlier <= {(WHOLE_BLOCKS + 1){1'b0}};
            out_valid <= 1'b0;
        end else if (en) begin
            index <= next_index;
            earlier <= next_earlier;
            if (next_index == REST) out_valid <= next_earlier[WHOLE_BLOCKS-1];
            if (at_start) is_flush <= !available;
        end
    end
endmodule
