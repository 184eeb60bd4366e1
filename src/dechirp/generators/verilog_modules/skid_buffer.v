// Register slice of a stream: no path from the ready of its output to that of its input.
module dechirp_skid_buffer #(
    parameter BITS = 32
) (
    input  wire            clk,
    input  wire            rst,
    input  wire            in_valid,
    output wire            in_ready,
    input  wire [BITS-1:0] in_data,
    output reg             out_valid,
    input  wire            out_ready,
    output reg  [BITS-1:0] out_data
);
    reg            holds;  // a second word waits
    reg [BITS-1:0] held;
    assign in_ready = !holds;
    wire move = !out_valid || out_ready;
    always @(posedge clk) begin
        if (rst) begin
            holds <= 1'b0;
            out_valid <= 1'b0;
        end else if (move) begin
            holds <= 1'b0;
            out_valid <= holds || in_valid;
        end else if (in_valid && !holds) begin
            holds <= 1'b1;
        end
    end
    always @(posedge clk) begin
        if (move) out_data <= holds ? held : in_data;
        if (!holds) held <= in_data;
    end
endmodule
