// Cell-averaging CFAR detector on a stream of powers, range bin by range bin, one cell a clock.
//
// The training window is that of the model: velocity wraps round; at the ends of range the box
// stays within the map and the cell under test moves off its centre.
//
// 1. Delay lines of whole range bins supply the powers that enter and leave the box and the guard.
//    Column sums over range follow by one addition and one subtraction a cell. Those of the first
//    box and guard of a frame grow in sums of their own, while the frame before still needs the
//    others.
// 2. A double buffer holds the column sums of one range bin; a sliding sum over velocity adds and
//    subtracts one column a cell. Its first value is summed up while the buffer is written.
// 3. threshold = floor(sum x factor / 2^FACTOR_SHIFT), at most the largest word.
//
// The first 2 HALF_RANGE range bins of a frame push the last cells of the frame before out. If no
// cell follows for two range bins, as many steps without input do so; `in_ready` is 0 in the
// meantime.
module dechirp_cfar #(
    parameter POWER_BITS = 48,
    parameter N_ROWS = 256,         // range bins
    parameter VELOCITY_BITS = 6,    // log2 of the velocity bins
    parameter ROW_BITS = 8,
    parameter HALF_RANGE = 14,      // training and guard cells on each side
    parameter HALF_VELOCITY = 12,
    parameter GUARD_RANGE = 4,
    parameter GUARD_VELOCITY = 4,
    parameter FACTOR_BITS = 16,
    parameter FACTOR_SHIFT = 20
) (
    input  wire                     clk,
    input  wire                     rst,
    input  wire                     in_valid,
    output wire                     in_ready,
    input  wire [POWER_BITS-1:0]    in_power,
    output wire [ROW_BITS-1:0]      factor_address,  // the factor is read one step later
    output wire                     factor_en,
    input  wire [FACTOR_BITS-1:0]   factor,
    output reg                      out_valid,
    input  wire                     out_ready,
    output reg  [POWER_BITS-1:0]    out_power,
    output reg  [POWER_BITS-1:0]    out_threshold,
    output reg                      out_detected,
    output reg  [ROW_BITS-1:0]      out_row,
    output reg  [VELOCITY_BITS-1:0] out_velocity
);
    localparam N_VELOCITY = 1 << VELOCITY_BITS;
    localparam H = HALF_RANGE, G = GUARD_RANGE;
    // Steps from a cell at the input of the sliding sum to the output, less one buffered bin.
    localparam PIPELINE = 10;
    localparam EXTRA_ROWS = 1 + ((PIPELINE + N_VELOCITY - 1) >> VELOCITY_BITS);
    localparam N_STEPS_ROWS = N_ROWS + 2 * H + EXTRA_ROWS;
    localparam COUNT_BITS = $clog2(N_STEPS_ROWS + 1) + 1;  // signed
    localparam COLUMN_BITS = POWER_BITS + $clog2(2 * H + 2);
    localparam SUM_BITS = COLUMN_BITS + $clog2(2 * HALF_VELOCITY + 2);

    // Rows at which something begins or ends.
    localparam [31:0] ROWS_32 = N_ROWS, LAST_ROW_32 = N_ROWS - 1;
    localparam [31:0] LAST_STEP_ROW_32 = N_STEPS_ROWS - 1;
    localparam [31:0] BOX_MOVES_32 = 3 * H + 1, BOX_ENDS_32 = N_ROWS + H;
    localparam [31:0] GUARD_BEGINS_32 = 2 * H - G, GUARD_SUBTRACTS_32 = 2 * H + G + 1;
    localparam [31:0] GUARD_ENDS_32 = N_ROWS + 2 * H - G;
    localparam [31:0] CELLS_BEGIN_32 = 2 * H, CELLS_END_32 = N_ROWS + 2 * H;
    localparam signed [COUNT_BITS-1:0] ROWS = ROWS_32[COUNT_BITS-1:0];
    localparam signed [COUNT_BITS-1:0] LAST_ROW = LAST_ROW_32[COUNT_BITS-1:0];
    localparam signed [COUNT_BITS-1:0] LAST_STEP_ROW = LAST_STEP_ROW_32[COUNT_BITS-1:0];
    localparam signed [COUNT_BITS-1:0] BOX_MOVES = BOX_MOVES_32[COUNT_BITS-1:0];
    localparam signed [COUNT_BITS-1:0] BOX_ENDS = BOX_ENDS_32[COUNT_BITS-1:0];
    localparam signed [COUNT_BITS-1:0] GUARD_BEGINS = GUARD_BEGINS_32[COUNT_BITS-1:0];
    localparam signed [COUNT_BITS-1:0] GUARD_ENDS = GUARD_ENDS_32[COUNT_BITS-1:0];
    localparam signed [COUNT_BITS-1:0] GUARD_SUBTRACTS = GUARD_SUBTRACTS_32[COUNT_BITS-1:0];
    localparam signed [COUNT_BITS-1:0] CELLS_BEGIN = CELLS_BEGIN_32[COUNT_BITS-1:0];
    localparam signed [COUNT_BITS-1:0] CELLS_END = CELLS_END_32[COUNT_BITS-1:0];

    reg  signed [COUNT_BITS-1:0] row;
    reg  [VELOCITY_BITS-1:0] v;
    reg  [VELOCITY_BITS:0] idle;
    reg  follows;   // this frame, or its first step that still waits, follows another without a flush
    reg  is_flush;  // steps without input, after the last row
    wire out_free = !out_valid || out_ready;
    wire step = out_free && (is_flush || in_valid);
    wire waits = follows && row == {COUNT_BITS{1'b0}} && v == {VELOCITY_BITS{1'b0}};
    assign in_ready = out_free && !is_flush;

    always @(posedge clk) begin
        if (rst) begin
            row <= {COUNT_BITS{1'b0}};
            v <= {VELOCITY_BITS{1'b0}};
            idle <= {(VELOCITY_BITS + 1){1'b0}};
            follows <= 1'b0;
            is_flush <= 1'b0;
        end else if (step) begin
            v <= v + 1'b1;
            idle <= {(VELOCITY_BITS + 1){1'b0}};
            if (&v) begin
                row <= row == (is_flush ? LAST_STEP_ROW : LAST_ROW) ? {COUNT_BITS{1'b0}} : row + 1'b1;
                if (row == LAST_ROW) follows <= 1'b1;
                if (row == LAST_STEP_ROW) is_flush <= 1'b0;
            end
        end else if (waits) begin
            idle <= idle + 1'b1;
            if (&idle) begin
                row <= ROWS;
                follows <= 1'b0;
                is_flush <= 1'b1;
            end
        end
    end

    // 1. Taps of the delay lines, by how many range bins they lie behind the input.
    wire [POWER_BITS-1:0] tap_box_add, tap_guard_add, tap_cell, tap_guard_subtract, tap_box_subtract;
    dechirp_delay_line #(POWER_BITS, H << VELOCITY_BITS)
        line_box_add (clk, rst, step, in_power, tap_box_add);
    dechirp_delay_line #(POWER_BITS, (H - G) << VELOCITY_BITS)
        line_guard_add (clk, rst, step, tap_box_add, tap_guard_add);
    dechirp_delay_line #(POWER_BITS, G << VELOCITY_BITS)
        line_cell (clk, rst, step, tap_guard_add, tap_cell);
    dechirp_delay_line #(POWER_BITS, (G + 1) << VELOCITY_BITS)
        line_guard_subtract (clk, rst, step, tap_cell, tap_guard_subtract);
    dechirp_delay_line #(POWER_BITS, (H - G) << VELOCITY_BITS)
        line_box_subtract (clk, rst, step, tap_guard_subtract, tap_box_subtract);

    // Step 1: what changes in each column. `row` of the frame before is higher by N_ROWS; its last
    // cell leaves in the step before `takes_over`, with which the sums of this frame take over.
    wire takes_over = row == CELLS_BEGIN;
    wire signed [COUNT_BITS-1:0] sums_row = row < CELLS_BEGIN ? row + ROWS : row;
    wire moves = sums_row >= BOX_MOVES && sums_row < BOX_ENDS;
    wire guard_adds = sums_row < GUARD_ENDS;
    wire guard_subtracts = sums_row >= GUARD_SUBTRACTS;
    reg  [POWER_BITS-1:0] box_added_1, guard_added_1;  // to the sums of this frame
    reg  [COLUMN_BITS-1:0] box_change_1, guard_change_1;
    reg  guard_begins_1, takes_over_1;
    reg  [POWER_BITS-1:0] cell_1;
    reg  first_1, valid_1;
    reg  [VELOCITY_BITS-1:0] v_1;
    reg  [ROW_BITS-1:0] row_1;
    wire [ROW_BITS-1:0] cell_row = sums_row[ROW_BITS-1:0] - CELLS_BEGIN_32[ROW_BITS-1:0];
    localparam [POWER_BITS-1:0] ZERO = {POWER_BITS{1'b0}};
    localparam WIDER = COLUMN_BITS - POWER_BITS;
    always @(posedge clk) begin
        if (step) begin
            box_added_1 <= in_power;
            guard_added_1 <= tap_guard_add;
            box_change_1 <= {{WIDER{1'b0}}, moves ? tap_box_add : ZERO}
                - {{WIDER{1'b0}}, moves ? tap_box_subtract : ZERO};
            guard_change_1 <= {{WIDER{1'b0}}, guard_adds ? tap_guard_add : ZERO}
                - {{WIDER{1'b0}}, guard_subtracts ? tap_guard_subtract : ZERO};
            cell_1 <= tap_cell;
            first_1 <= row == {COUNT_BITS{1'b0}};
            guard_begins_1 <= row == GUARD_BEGINS;
            takes_over_1 <= takes_over;
            row_1 <= cell_row;
        end
    end
    // Control words of a step start at zero, so that no old cell leaves after a reset.
    always @(posedge clk) begin
        if (rst) begin
            valid_1 <= 1'b0;
            v_1 <= {VELOCITY_BITS{1'b1}};
        end else if (step) begin
            valid_1 <= row >= CELLS_BEGIN ? row < CELLS_END : follows;
            v_1 <= v;
        end
    end

    // Step 2: column sums; each comes back from a delay line after one range bin.
    localparam [COLUMN_BITS-1:0] COLUMN_ZERO = {COLUMN_BITS{1'b0}};
    wire [COLUMN_BITS-1:0] box_before, guard_before, first_box_before, first_guard_before;
    wire [COLUMN_BITS-1:0] first_box = (first_1 ? COLUMN_ZERO : first_box_before)
        + {{WIDER{1'b0}}, box_added_1};
    wire [COLUMN_BITS-1:0] first_guard = (guard_begins_1 ? COLUMN_ZERO : first_guard_before)
        + {{WIDER{1'b0}}, guard_added_1};
    wire [COLUMN_BITS-1:0] box_column = takes_over_1 ? first_box : box_before + box_change_1;
    wire [COLUMN_BITS-1:0] guard_column
        = takes_over_1 ? first_guard : guard_before + guard_change_1;
    dechirp_delay_line #(COLUMN_BITS, N_VELOCITY)
        first_box_memory (clk, rst, step, first_box, first_box_before),
        first_guard_memory (clk, rst, step, first_guard, first_guard_before),
        box_memory (clk, rst, step, box_column, box_before),
        guard_memory (clk, rst, step, guard_column, guard_before);

    reg  [COLUMN_BITS-1:0] box_2, guard_2;
    reg  [POWER_BITS-1:0] cell_2;
    reg  [ROW_BITS-1:0] row_2;
    reg  [VELOCITY_BITS-1:0] v_2;
    reg  valid_2, bank;
    always @(posedge clk) begin
        if (step) begin
            box_2 <= box_column;
            guard_2 <= guard_column;
            cell_2 <= cell_1;
            row_2 <= row_1;
        end
    end
    always @(posedge clk) begin
        if (rst) begin
            valid_2 <= 1'b0;
            v_2 <= {VELOCITY_BITS{1'b1}};
            bank <= 1'b0;
        end else if (step) begin
            valid_2 <= valid_1;
            v_2 <= v_1;
            if (&v_2) bank <= !bank;
        end
    end

    // Step 3: write the columns of this range bin, and read those of the one before.
    localparam [31:0] HV = HALF_VELOCITY, GV = GUARD_VELOCITY;
    localparam RAM_BITS = VELOCITY_BITS + 1;
    wire [RAM_BITS-1:0] write_address = {bank, v_2};
    wire [VELOCITY_BITS-1:0] v_box_enters = v_2 + HV[VELOCITY_BITS-1:0] + 1'b1;
    wire [VELOCITY_BITS-1:0] v_box_leaves = v_2 - HV[VELOCITY_BITS-1:0];
    wire [VELOCITY_BITS-1:0] v_guard_enters = v_2 + GV[VELOCITY_BITS-1:0] + 1'b1;
    wire [VELOCITY_BITS-1:0] v_guard_leaves = v_2 - GV[VELOCITY_BITS-1:0];
    wire [COLUMN_BITS-1:0] box_enters, box_leaves, guard_enters, guard_leaves;
    wire [POWER_BITS-1:0] cell_3;
    dechirp_ram #(COLUMN_BITS, 2 * N_VELOCITY, RAM_BITS)
        ram_box_enters (clk, step, write_address, box_2, step, {!bank, v_box_enters}, box_enters),
        ram_box_leaves (clk, step, write_address, box_2, step, {!bank, v_box_leaves}, box_leaves),
        ram_guard_enters
            (clk, step, write_address, guard_2, step, {!bank, v_guard_enters}, guard_enters),
        ram_guard_leaves
            (clk, step, write_address, guard_2, step, {!bank, v_guard_leaves}, guard_leaves);
    dechirp_ram #(POWER_BITS, 2 * N_VELOCITY, RAM_BITS)
        ram_cell (clk, step, write_address, cell_2, step, {!bank, v_2}, cell_3);

    // The sum at the first velocity: columns of the box less those of the guard, round the end.
    localparam [31:0] NV = N_VELOCITY;
    localparam [VELOCITY_BITS-1:0] BOX_LOW = HV[VELOCITY_BITS-1:0];
    localparam [31:0] BOX_HIGH_32 = NV - HV, GUARD_HIGH_32 = NV - GV;
    localparam [VELOCITY_BITS-1:0] GUARD_LOW = GV[VELOCITY_BITS-1:0];
    wire in_box = v_2 <= BOX_LOW || {1'b0, v_2} >= BOX_HIGH_32[VELOCITY_BITS:0];
    wire in_guard = v_2 <= GUARD_LOW || {1'b0, v_2} >= GUARD_HIGH_32[VELOCITY_BITS:0];
    localparam SUM_WIDER = SUM_BITS - COLUMN_BITS;
    wire [COLUMN_BITS-1:0] first_added = in_box ? box_2 : COLUMN_ZERO;
    wire [COLUMN_BITS-1:0] first_subtracted = in_guard ? guard_2 : COLUMN_ZERO;
    reg  [SUM_BITS-1:0] first_sum, first_sum_held, box_change, guard_change, change, sum;
    reg  [VELOCITY_BITS-1:0] v_3, v_4, v_5;
    reg  [ROW_BITS-1:0] row_before, row_3, row_4, row_5;
    reg  [POWER_BITS-1:0] cell_4, cell_5;
    reg  valid_before, valid_3, valid_4, valid_5;
    always @(posedge clk) begin
        if (step) begin
            first_sum <= (v_2 == {VELOCITY_BITS{1'b0}} ? {SUM_BITS{1'b0}} : first_sum)
                + {{SUM_WIDER{1'b0}}, first_added} - {{SUM_WIDER{1'b0}}, first_subtracted};
            if (&v_2) row_before <= row_2;
            row_3 <= row_before;
            // The next range bin starts its own first sum in the step in which this one is taken.
            if (v_2 == {VELOCITY_BITS{1'b0}}) first_sum_held <= first_sum;
            // Step 4: the change to the next velocity. Step 5: the sum at this one.
            box_change <= {{SUM_WIDER{1'b0}}, box_enters} - {{SUM_WIDER{1'b0}}, box_leaves};
            guard_change <= {{SUM_WIDER{1'b0}}, guard_enters} - {{SUM_WIDER{1'b0}}, guard_leaves};
            cell_4 <= cell_3;
            row_4 <= row_3;
            change <= box_change - guard_change;
            sum <= v_4 == {VELOCITY_BITS{1'b0}} ? first_sum_held : sum + change;
            cell_5 <= cell_4;
            row_5 <= row_4;
        end
    end
    always @(posedge clk) begin
        if (rst) begin
            valid_before <= 1'b0;
            valid_3 <= 1'b0;
            valid_4 <= 1'b0;
            valid_5 <= 1'b0;
            v_3 <= {VELOCITY_BITS{1'b1}};
            v_4 <= {VELOCITY_BITS{1'b1}};
            v_5 <= {VELOCITY_BITS{1'b1}};
        end else if (step) begin
            if (&v_2) valid_before <= valid_2;
            valid_3 <= valid_before;
            valid_4 <= valid_3;
            valid_5 <= valid_4;
            v_3 <= v_2;
            v_4 <= v_3;
            v_5 <= v_4;
        end
    end

    // Step 6: limbs of the sum times the factor, which the row selected two steps earlier.
    localparam LIMB_BITS = FACTOR_BITS > 17 ? FACTOR_BITS : 17;  // multipliers have 18 bits
    localparam N_LIMBS = (SUM_BITS + LIMB_BITS - 1) / LIMB_BITS;
    localparam PADDED_BITS = N_LIMBS * LIMB_BITS;
    localparam PRODUCT_BITS = PADDED_BITS + FACTOR_BITS;
    wire [PADDED_BITS-1:0] padded = {{(PADDED_BITS - SUM_BITS){1'b0}}, sum};
    reg  [N_LIMBS*(LIMB_BITS+FACTOR_BITS)-1:0] limbs;
    assign factor_address = row_3;
    assign factor_en = step;
    reg  [FACTOR_BITS-1:0] factor_5;
    always @(posedge clk) if (step) factor_5 <= factor;
    reg  [POWER_BITS-1:0] cell_6, cell_7, cell_8;
    reg  [ROW_BITS-1:0] row_6, row_7, row_8;
    reg  [VELOCITY_BITS-1:0] v_6, v_7, v_8;
    reg  valid_6, valid_7, valid_8;
    genvar k;
    generate
        for (k = 0; k < N_LIMBS; k = k + 1) begin : limb
            wire [LIMB_BITS-1:0] part = padded[k*LIMB_BITS +: LIMB_BITS];
            always @(posedge clk) begin
                if (step) begin
                    limbs[k*(LIMB_BITS+FACTOR_BITS) +: LIMB_BITS+FACTOR_BITS]
                        <= {{FACTOR_BITS{1'b0}}, part} * {{LIMB_BITS{1'b0}}, factor_5};
                end
            end
        end
    endgenerate

    // Step 7: add the even limbs to the odd ones, which do not overlap each other. Step 8: the sum.
    reg  [PRODUCT_BITS-1:0] even, odd, even_7, odd_7, product_8;
    integer n;
    always @* begin
        even = {PRODUCT_BITS{1'b0}};
        odd = {PRODUCT_BITS{1'b0}};
        for (n = 0; n < N_LIMBS; n = n + 1) begin
            if (n % 2 == 0)
                even = even | ({{(PRODUCT_BITS - LIMB_BITS - FACTOR_BITS){1'b0}},
                    limbs[n*(LIMB_BITS+FACTOR_BITS) +: LIMB_BITS+FACTOR_BITS]} << (n * LIMB_BITS));
            else
                odd = odd | ({{(PRODUCT_BITS - LIMB_BITS - FACTOR_BITS){1'b0}},
                    limbs[n*(LIMB_BITS+FACTOR_BITS) +: LIMB_BITS+FACTOR_BITS]} << (n * LIMB_BITS));
        end
    end
    always @(posedge clk) begin
        if (step) begin
            even_7 <= even;
            odd_7 <= odd;
            product_8 <= even_7 + odd_7;
            cell_6 <= cell_5;
            cell_7 <= cell_6;
            cell_8 <= cell_7;
            row_6 <= row_5;
            row_7 <= row_6;
            row_8 <= row_7;
            v_6 <= v_5;
            v_7 <= v_6;
            v_8 <= v_7;
        end
    end

    // Step 9: the threshold word and the comparison.
    localparam SHIFTED_BITS = PRODUCT_BITS > POWER_BITS ? PRODUCT_BITS : POWER_BITS + 1;
    wire [SHIFTED_BITS-1:0] shifted
        = {{(SHIFTED_BITS - PRODUCT_BITS){1'b0}}, product_8} >> FACTOR_SHIFT;
    wire too_large = |shifted[SHIFTED_BITS-1:POWER_BITS];
    wire [POWER_BITS-1:0] threshold = too_large ? {POWER_BITS{1'b1}} : shifted[POWER_BITS-1:0];
    always @(posedge clk) begin
        if (rst) begin
            valid_6 <= 1'b0;
            valid_7 <= 1'b0;
            valid_8 <= 1'b0;
            out_valid <= 1'b0;
        end else if (step) begin
            valid_6 <= valid_5;
            valid_7 <= valid_6;
            valid_8 <= valid_7;
            out_valid <= valid_8;
        end else if (out_ready) begin
            out_valid <= 1'b0;
        end
    end
    always @(posedge clk) begin
        if (step) begin
            out_power <= cell_8;
            out_threshold <= threshold;
            out_detected <= cell_8 > threshold;
            out_row <= row_8;
            out_velocity <= v_8;
        end
    end
endmodule
