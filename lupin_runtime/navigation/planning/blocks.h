/* A grid of cells as blocks of 8 x 8, one 64-bit word each, with the queries of a search: neighbors and lines of sight. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* MANY_NODES keeps a search through a map of 2000 x 2000 cells within tens of milliseconds. */
enum { EDGE = 8, FEW_CELLS = 65536, MANY_NODES = 300000, MAX_NEIGHBORS = 128 };

#define ALL (~(uint64_t)0)
#define COLUMN_FIRST 0x0101010101010101ULL
#define COLUMN_LAST 0x8080808080808080ULL

#define WINDOW(size) ((size) == 8 ? ALL : (size) == 4 ? 0x0F0F0F0FULL : (size) == 2 ? 0x0303ULL : 1ULL)

typedef struct {
    const uint8_t *blocked;
    int64_t height, width, rows, columns, components;
    uint64_t *free;    /* per block: bit 8 r + c is set if the cell is free */
    uint8_t *clear;    /* per block: the distance, in blocks, to the nearest one that is not wholly free */
    uint16_t *runs[4]; /* per block: the number of wholly free blocks from it on, itself included; right, left, up, down */
    int32_t *first;    /* per block: its first component; one more entry at the end */
    uint64_t *mask;    /* per component: its cells */
    int32_t *block;    /* per component: its block */
    int32_t *x, *y;    /* per component: the cell that represents it */
} Field;

static uint64_t free_bits(const Field *field, int64_t row, int64_t column) {
    if (row < 0 || column < 0 || row >= field->rows || column >= field->columns) return 0;
    return field->free[row * field->columns + column];
}

static uint64_t flood(uint64_t seed, uint64_t mask) {
    if (mask == ALL) return ALL;
    for (uint64_t filled = seed;;) {
        const uint64_t grown =
            (filled | (filled << 8) | (filled >> 8) | ((filled & ~COLUMN_LAST) << 1) | ((filled & ~COLUMN_FIRST) >> 1)) & mask;
        if (grown == filled) return filled;
        filled = grown;
    }
}

/* Returns the cells of a block around which a shortest path may bend: a diagonal neighbor is blocked and both cells beside it
 * are free. */
static uint64_t corner_bits(const Field *field, int64_t row, int64_t column) {
    uint64_t grid[3][3];
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) grid[r][c] = free_bits(field, row + r - 1, column + c - 1);
    uint64_t above[3], below[3];
    for (int c = 0; c < 3; c++) {
        above[c] = (grid[1][c] >> 8) | (grid[2][c] << 56);
        below[c] = (grid[1][c] << 8) | (grid[0][c] >> 56);
    }
#define EAST(band) ((((band)[1] >> 1) & ~COLUMN_LAST) | (((band)[2] & COLUMN_FIRST) << 7))
#define WEST(band) ((((band)[1] << 1) & ~COLUMN_FIRST) | (((band)[0] & COLUMN_LAST) >> 7))
    const uint64_t east = EAST(grid[1]), west = WEST(grid[1]);
    return grid[1][1] & ((above[1] & east & ~EAST(above)) | (above[1] & west & ~WEST(above)) |
                         (below[1] & east & ~EAST(below)) | (below[1] & west & ~WEST(below)));
}

static int place_of(uint64_t mask, uint64_t corners) {
    static const uint64_t rings[4] = {0x0000001818000000ULL, 0x00003C3C3C3C0000ULL, 0x007E7E7E7E7E7E00ULL, ALL};
    const uint64_t wanted = mask & corners ? mask & corners : mask;
    for (int i = 0; i < 4; i++)
        if (wanted & rings[i]) return __builtin_ctzll(wanted & rings[i]);
    return 0;
}

static void field_free(Field *field) {
    free(field->free);
    free(field->clear);
    for (int k = 0; k < 4; k++) free(field->runs[k]);
    free(field->first);
    free(field->mask);
    free(field->block);
    free(field->x);
    free(field->y);
}

static int field_build(Field *field, const uint8_t *blocked, int64_t height, int64_t width) {
    memset(field, 0, sizeof *field);
    field->blocked = blocked;
    field->height = height;
    field->width = width;
    field->rows = (height + EDGE - 1) / EDGE;
    field->columns = (width + EDGE - 1) / EDGE;
    const int64_t blocks = field->rows * field->columns;
    field->free = calloc((size_t)blocks, sizeof(uint64_t));
    field->clear = calloc((size_t)blocks, 1);
    field->first = malloc((size_t)(blocks + 1) * sizeof(int32_t));
    for (int k = 0; k < 4; k++)
        if (!(field->runs[k] = calloc((size_t)blocks, sizeof(uint16_t)))) return 0;
    if (!field->free || !field->clear || !field->first) return 0;
    for (int64_t y = 0; y < height; y++) {
        uint64_t *band = field->free + (y / EDGE) * field->columns;
        const uint8_t *row = blocked + y * width;
        const int shift = (int)(y % EDGE) * 8;
        for (int64_t c = 0; c < width / EDGE; c++) {
            uint64_t eight;
            memcpy(&eight, row + c * EDGE, 8);
            eight = (eight | (eight >> 4)) & 0x0F0F0F0F0F0F0F0FULL;
            eight = (eight | (eight >> 2)) & 0x0303030303030303ULL;
            eight = (eight | (eight >> 1)) & COLUMN_FIRST; /* any non-zero byte is 1 now */
            band[c] |= (~((eight * 0x0102040810204080ULL) >> 56) & 0xFF) << shift;
        }
        for (int64_t x = width / EDGE * EDGE; x < width; x++)
            if (!row[x]) band[x / EDGE] |= (uint64_t)1 << (shift + x % EDGE);
    }
    /* Blocks with a corner of an obstacle, at which paths bend, are cut into windows as small as the number of nodes allows. On
     * a small map every cell is a node. */
    int64_t bends = 0;
    for (int64_t b = 0; b < blocks; b++)
        bends += field->free[b] != ALL && corner_bits(field, b / field->columns, b % field->columns) != 0;
    const int whole = height * width <= FEW_CELLS ? 1 : EDGE;
    const int split = whole == 1 || bends * 64 <= MANY_NODES ? 1 : bends * 16 <= MANY_NODES ? 2 : 4;
    /* Components, in two passes: count, then store. */
    for (int pass = 0; pass < 2; pass++) {
        int64_t count = 0;
        for (int64_t b = 0; b < blocks; b++) {
            field->first[b] = (int32_t)count;
            const uint64_t corners = field->free[b] == ALL ? 0 : corner_bits(field, b / field->columns, b % field->columns);
            const int size = corners ? split : whole;
            for (int r = 0; r < EDGE; r += size)
                for (int c = 0; c < EDGE; c += size)
                    for (uint64_t left = field->free[b] & (WINDOW(size) << (8 * r + c)); left;) {
                        const uint64_t part = flood(left & -left, left);
                        if (pass) {
                            field->mask[count] = part;
                            field->block[count] = (int32_t)b;
                        }
                        left &= ~part;
                        count++;
                    }
        }
        field->first[blocks] = (int32_t)count;
        if (pass) break;
        field->components = count;
        const size_t n = (size_t)(count + 1);
        field->mask = malloc(n * sizeof(uint64_t));
        field->block = malloc(n * sizeof(int32_t));
        field->x = malloc(n * sizeof(int32_t));
        field->y = malloc(n * sizeof(int32_t));
        if (!field->mask || !field->block || !field->x || !field->y) return 0;
    }
    for (int64_t b = 0; b < blocks; b++) {
        if (field->first[b] == field->first[b + 1]) continue;
        const int64_t row = b / field->columns, column = b % field->columns;
        const uint64_t corners = field->free[b] == ALL ? 0 : corner_bits(field, row, column);
        for (int32_t i = field->first[b]; i < field->first[b + 1]; i++) {
            const int at = place_of(field->mask[i], corners);
            field->x[i] = (int32_t)(column * EDGE + at % EDGE);
            field->y[i] = (int32_t)(row * EDGE + at / EDGE);
        }
    }
    /* Chebyshev distance in blocks to the nearest one that is not wholly free, in a pass from each end. */
    for (int pass = 0; pass < 2; pass++)
        for (int64_t i = 0; i < blocks; i++) {
            const int64_t b = pass ? blocks - 1 - i : i, row = b / field->columns, column = b % field->columns;
            if (field->free[b] != ALL) continue;
            int least = 254;
            for (int k = 0; k < 4; k++) {
                static const int steps[4][2] = {{0, -1}, {-1, -1}, {-1, 0}, {-1, 1}};
                const int64_t r = row + (pass ? -steps[k][0] : steps[k][0]), c = column + (pass ? -steps[k][1] : steps[k][1]);
                const int there = r < 0 || c < 0 || r >= field->rows || c >= field->columns ? 0 : field->clear[r * field->columns + c];
                least = there < least ? there : least;
            }
            if (!pass || least + 1 < field->clear[b]) field->clear[b] = (uint8_t)(least + 1);
            uint16_t *across = field->runs[pass ? 0 : 1], *along = field->runs[pass ? 2 : 3];
            const int64_t back = pass ? 1 : -1, next = column + back, over = row + back;
            const int beside = next >= 0 && next < field->columns ? across[b + back] : 0;
            const int above = over >= 0 && over < field->rows ? along[b + back * field->columns] : 0;
            across[b] = (uint16_t)(beside < UINT16_MAX ? beside + 1 : beside);
            along[b] = (uint16_t)(above < UINT16_MAX ? above + 1 : above);
        }
    return 1;
}

static int is_blocked(const Field *field, int64_t x, int64_t y) {
    return x < 0 || y < 0 || x >= field->width || y >= field->height || field->blocked[y * field->width + x];
}

/* Returns whether every cell that the segment between two cells' centers touches is free. */
static int sees(const Field *field, int32_t ax, int32_t ay, int32_t bx, int32_t by) {
    const int64_t dx = bx - ax, dy = by - ay, wide = llabs(dx), tall = llabs(dy), sx = dx < 0 ? -1 : 1, sy = dy < 0 ? -1 : 1;
    int64_t x = ax, y = ay;
    /* Twice the area between the line and the corner ahead: its sign says which border is crossed next. */
    int64_t balance = wide - tall;
    for (int64_t left = wide + tall; left > 0;) {
        const int64_t row = y / EDGE, column = x / EDGE;
        const int around = field->clear[row * field->columns + column];
        if (around > 0) {
            /* Jump within the free square of blocks around, or the free row or column of blocks ahead: whichever reaches
             * farther. Its border is `in_x` columns and `in_y` rows ahead. */
            const int64_t b = row * field->columns + column;
            const int64_t own_x = sx > 0 ? (column + 1) * EDGE - 1 - x : x - column * EDGE;
            const int64_t own_y = sy > 0 ? (row + 1) * EDGE - 1 - y : y - row * EDGE;
            int64_t in_x = own_x + (around - 1) * EDGE, in_y = own_y + (around - 1) * EDGE;
            const int64_t run_x = own_x + (field->runs[sx > 0 ? 0 : 1][b] - 1) * EDGE;
            const int64_t run_y = own_y + (field->runs[sy > 0 ? 2 : 3][b] - 1) * EDGE;
            int64_t farthest = in_x * tall < in_y * wide ? in_x * tall : in_y * wide;
            const int64_t far_x = run_x * tall < own_y * wide ? run_x * tall : own_y * wide;
            const int64_t far_y = own_x * tall < run_y * wide ? own_x * tall : run_y * wide;
            if (far_x > farthest) {
                farthest = far_x;
                in_x = run_x;
                in_y = own_y;
            }
            if (far_y > farthest) {
                in_x = own_x;
                in_y = run_y;
            }
            int64_t i, j;
            if (in_x * tall <= in_y * wide) {
                i = in_x < llabs(bx - x) ? in_x : llabs(bx - x);
                j = wide ? ((llabs(x + sx * i - ax) * 2) * tall + wide) / (2 * wide) - llabs(y - ay) : 0;
            } else {
                j = in_y < llabs(by - y) ? in_y : llabs(by - y);
                i = tall ? ((llabs(y + sy * j - ay) * 2) * wide + tall) / (2 * tall) - llabs(x - ax) : in_x;
            }
            if (i >= 0 && j >= 0 && i <= in_x && j <= in_y && i + j > 2) {
                x += sx * i;
                y += sy * j;
                left = llabs(bx - x) + llabs(by - y);
                /* The steps taken in x and y since the start determine the balance. */
                balance = wide - tall + 2 * (llabs(y - ay) * wide - llabs(x - ax) * tall);
                if (field->blocked[y * field->width + x]) return 0;
                if (left == 0) return 1;
                continue;
            }
        }
        if (balance > 0) {
            x += sx;
            balance -= 2 * tall;
            left--;
        } else if (balance < 0) {
            y += sy;
            balance += 2 * wide;
            left--;
        } else { /* through a corner: neither of the cells beside it may be blocked */
            if (field->blocked[y * field->width + x + sx] || field->blocked[(y + sy) * field->width + x]) return 0;
            x += sx;
            y += sy;
            balance += 2 * wide - 2 * tall;
            left -= 2;
        }
        if (field->blocked[y * field->width + x]) return 0;
    }
    return 1;
}

static int32_t component_at(const Field *field, int64_t x, int64_t y) {
    const int64_t b = (y / EDGE) * field->columns + x / EDGE;
    const uint64_t bit = (uint64_t)1 << ((y % EDGE) * 8 + x % EDGE);
    for (int32_t i = field->first[b]; i < field->first[b + 1]; i++)
        if (field->mask[i] & bit) return i;
    return -1;
}

static int neighbors(const Field *field, int32_t node, int32_t *out) {
    const int64_t b = field->block[node], row = b / field->columns, column = b % field->columns;
    const uint64_t mask = field->mask[node];
    const uint64_t beyond[4] = {(mask & COLUMN_LAST) >> 7, (mask & COLUMN_FIRST) << 7, mask >> 56, mask << 56};
    static const int step[4][2] = {{0, 1}, {0, -1}, {1, 0}, {-1, 0}};
    int count = 0;
    for (int k = 0; k < 4; k++) {
        const int64_t r = row + step[k][0], c = column + step[k][1];
        if (!beyond[k] || r < 0 || c < 0 || r >= field->rows || c >= field->columns) continue;
        const int64_t other = r * field->columns + c;
        for (int32_t i = field->first[other]; i < field->first[other + 1]; i++)
            if (field->mask[i] & beyond[k]) out[count++] = i;
    }
    if (mask != ALL) {
        const uint64_t grown = (mask << 8) | (mask >> 8) | ((mask & ~COLUMN_LAST) << 1) | ((mask & ~COLUMN_FIRST) >> 1);
        for (int32_t i = field->first[b]; i < field->first[b + 1]; i++)
            if (i != node && (field->mask[i] & grown)) out[count++] = i;
    }
    /* Diagonal neighbors, if the four cells around the blocks' common corner are free. */
    static const int diagonal[4][2] = {{1, 1}, {1, -1}, {-1, 1}, {-1, -1}};
    for (int k = 0; k < 4; k++) {
        const int up = diagonal[k][0] > 0, right = diagonal[k][1] > 0;
        const int64_t y = row * EDGE + (up ? EDGE - 1 : 0), x = column * EDGE + (right ? EDGE - 1 : 0);
        if (!(mask >> ((up ? 56 : 0) + (right ? 7 : 0)) & 1)) continue;
        const int64_t fy = y + diagonal[k][0], fx = x + diagonal[k][1];
        if (is_blocked(field, fx, fy) || is_blocked(field, fx, y) || is_blocked(field, x, fy)) continue;
        out[count++] = component_at(field, fx, fy);
    }
    return count;
}
