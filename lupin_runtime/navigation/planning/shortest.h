/* The shortest path of any angle over a grid of blocked cells.
 *
 * The grid is cut into blocks of 8 x 8 cells, one 64-bit word each. What is connected within a block is one node, so that no
 * wall is lost, however thin, while a map of four million cells has some ten thousands of nodes. Lazy Theta* (Nash, Koenig &
 * Tovey 2010) finds the way round the obstacles over these nodes; its line-of-sight checks run on the cells and jump over free
 * blocks. Then the string is pulled tight on the cells, exactly, in integers. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* MANY_NODES keeps a search through a map of 2000 x 2000 cells within tens of milliseconds. */
enum { EDGE = 8, FEW_CELLS = 65536, MANY_NODES = 300000, OPEN = 1, CLOSED = 2, MAX_NEIGHBOURS = 128 };

#define ALL (~(uint64_t)0)
#define COLUMN_FIRST 0x0101010101010101ULL
#define COLUMN_LAST 0x8080808080808080ULL

#define WINDOW(size) ((size) == 8 ? ALL : (size) == 4 ? 0x0F0F0F0FULL : (size) == 2 ? 0x0303ULL : 1ULL)

typedef struct {
    const uint8_t *blocked;
    int64_t height, width, rows, columns, components;
    uint64_t *free;    /* per block: bit 8 r + c is set where the cell is free */
    uint8_t *clear;    /* per block: how many blocks around it, itself included, are wholly free */
    uint16_t *runs[4]; /* per block: how many blocks on from it, itself included, are wholly free; right, left, up, down */
    int32_t *first;    /* per block: its first component; one more at the end */
    uint64_t *mask;    /* per component: its cells */
    int32_t *block;    /* per component: its block */
    int32_t *x, *y;    /* per component: the cell that stands for it */
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

/* Cells of a block round which a shortest path may bend: a diagonal neighbour is blocked and both cells beside it are free. */
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
    /* Blocks with a corner of an obstacle, where paths bend, are cut into windows as small as the number of nodes allows. On
     * a small map every cell is a node. */
    int64_t bends = 0;
    for (int64_t b = 0; b < blocks; b++)
        bends += field->free[b] != ALL && corner_bits(field, b / field->columns, b % field->columns) != 0;
    const int whole = height * width <= FEW_CELLS ? 1 : EDGE;
    const int split = whole == 1 || bends * 64 <= MANY_NODES ? 1 : bends * 16 <= MANY_NODES ? 2 : 4;
    /* Components, in two passes: count, then keep. */
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
    /* Chebyshev distance in blocks to the nearest one that is not wholly free, from both ends. */
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

/* Whether every cell that the segment between two cells' centres touches is free. */
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
             * farther. `in_x` columns and `in_y` rows further on is its border. */
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
                /* Steps taken in x and y since the start fix the balance. */
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

static int neighbours(const Field *field, int32_t node, int32_t *out) {
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
    /* Diagonally where the four cells round the blocks' common corner are free. */
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

typedef struct {
    float key;
    int32_t node;
} Entry;

typedef struct {
    Entry *entries;
    int64_t count, capacity;
} Heap;

static int heap_push(Heap *heap, float key, int32_t node) {
    if (heap->count == heap->capacity) {
        const int64_t capacity = heap->capacity ? 2 * heap->capacity : 4096;
        Entry *entries = realloc(heap->entries, (size_t)capacity * sizeof(Entry));
        if (!entries) return 0;
        heap->entries = entries;
        heap->capacity = capacity;
    }
    int64_t i = heap->count++;
    while (i > 0 && heap->entries[(i - 1) / 4].key > key) {
        heap->entries[i] = heap->entries[(i - 1) / 4];
        i = (i - 1) / 4;
    }
    heap->entries[i] = (Entry){key, node};
    return 1;
}

static Entry heap_pop(Heap *heap) {
    const Entry top = heap->entries[0], last = heap->entries[--heap->count];
    int64_t i = 0;
    for (;;) {
        int64_t child = 4 * i + 1, least = -1;
        float key = last.key;
        for (int64_t c = child; c < child + 4 && c < heap->count; c++)
            if (heap->entries[c].key < key) {
                key = heap->entries[c].key;
                least = c;
            }
        if (least < 0) break;
        heap->entries[i] = heap->entries[least];
        i = least;
    }
    if (heap->count) heap->entries[i] = last;
    return top;
}

typedef struct {
    float *cost;      /* from the start, in cells */
    int32_t *parent;
    uint8_t *state;
    uint8_t *bent;    /* the way from the parent is no straight line; the parent is a neighbour then */
    Heap heap;
} Search;

static float apart(const Field *field, int32_t a, int32_t b) {
    const float dx = (float)(field->x[a] - field->x[b]), dy = (float)(field->y[a] - field->y[b]);
    return sqrtf(dx * dx + dy * dy);
}

static int sees_node(const Field *field, int32_t a, int32_t b) {
    return sees(field, field->x[a], field->y[a], field->x[b], field->y[b]);
}

/* A node's parent was assumed to be in sight and is not: take the best of the closed neighbours and of their parents. */
static void reconsider(const Field *field, Search *search, int32_t node, const int32_t *around, int count) {
    float costs[2 * MAX_NEIGHBOURS];
    int32_t parents[2 * MAX_NEIGHBOURS];
    int choices = 0, nearest = -1;
    float least = INFINITY;
    for (int i = 0; i < count; i++) {
        const int32_t n = around[i];
        if (search->state[n] != CLOSED) continue;
        const float through = search->cost[n] + apart(field, n, node);
        if (through < least) {
            least = through;
            nearest = n;
        }
        costs[choices] = through;
        parents[choices++] = n;
        if (search->parent[n] >= 0) {
            costs[choices] = search->cost[search->parent[n]] + apart(field, search->parent[n], node);
            parents[choices++] = search->parent[n];
        }
    }
    for (;;) {
        int best = -1;
        for (int i = 0; i < choices; i++)
            if (costs[i] < INFINITY && (best < 0 || costs[i] < costs[best])) best = i;
        if (best < 0) break;
        if (sees_node(field, parents[best], node)) {
            search->cost[node] = costs[best];
            search->parent[node] = parents[best];
            search->bent[node] = 0;
            return;
        }
        const int32_t refused = parents[best];
        for (int i = 0; i < choices; i++)
            if (parents[i] == refused) costs[i] = INFINITY;
    }
    /* Connected round a bend within the two blocks: a guess of its length will do, the string is pulled tight later. */
    search->parent[node] = nearest;
    search->cost[node] = search->cost[nearest] + 1.3f * apart(field, nearest, node);
    search->bent[node] = 1;
}

/* Returns 1 with the chain of parents filled, 0 when the goal can't be reached, -1 without memory. */
static int search_run(const Field *field, Search *search, int32_t start, int32_t goal) {
    int32_t around[MAX_NEIGHBOURS];
    for (int64_t i = 0; i < field->components; i++) search->cost[i] = INFINITY;
    memset(search->state, 0, (size_t)field->components);
    search->cost[start] = 0.0f;
    search->parent[start] = -1;
    search->bent[start] = 0;
    search->state[start] = OPEN;
    search->heap.count = 0;
    if (!heap_push(&search->heap, apart(field, start, goal), start)) return -1;
    while (search->heap.count) {
        const Entry top = heap_pop(&search->heap);
        const int32_t node = top.node;
        if (search->state[node] == CLOSED) continue;
        const int count = neighbours(field, node, around);
        if (search->parent[node] >= 0 && !search->bent[node] && !sees_node(field, search->parent[node], node)) {
            reconsider(field, search, node, around, count);
            const float key = search->cost[node] + apart(field, node, goal);
            if (search->heap.count && key > search->heap.entries[0].key) {
                if (!heap_push(&search->heap, key, node)) return -1;
                /* Its parent is in sight now; on its return the check is quick, or another one has come to be better. */
                continue;
            }
        }
        search->state[node] = CLOSED;
        if (node == goal) return 1;
        const int32_t from = search->parent[node] >= 0 && !search->bent[node] ? search->parent[node] : node;
        for (int i = 0; i < count; i++) {
            const int32_t n = around[i];
            if (search->state[n] == CLOSED) continue;
            const float cost = search->cost[from] + apart(field, from, n);
            if (cost < search->cost[n]) {
                search->cost[n] = cost;
                search->parent[n] = from;
                search->bent[n] = 0;
                search->state[n] = OPEN;
                if (!heap_push(&search->heap, cost + apart(field, n, goal), n)) return -1;
            }
        }
    }
    return 0;
}

/* -- from nodes to a string ---------------------------------------------------------------------------------------------- */
static Point centre_of(int64_t x, int64_t y) { return (Point){x * UNIT + UNIT / 2, y * UNIT + UNIT / 2}; }

/* Append the cells from one node to another one of a neighbouring block that it does not see: breadth first through the free
 * cells of the rectangle that holds both blocks. Returns 0 without memory. */
static int append_bend(const Field *field, String *string, int32_t from, int32_t to) {
    enum { SPAN = 2 * EDGE };
    const int64_t from_row = field->block[from] / field->columns, from_column = field->block[from] % field->columns;
    const int64_t to_row = field->block[to] / field->columns, to_column = field->block[to] % field->columns;
    const int64_t y0 = (from_row < to_row ? from_row : to_row) * EDGE, x0 = (from_column < to_column ? from_column : to_column) * EDGE;
    const int rows = from_row == to_row ? EDGE : SPAN, columns = from_column == to_column ? EDGE : SPAN;
    int16_t came[SPAN * SPAN], queue[SPAN * SPAN], way[SPAN * SPAN];
    memset(came, -1, sizeof came);
    int head = 0, tail = 0, length = 0;
    const int start = (int)((field->y[from] - y0) * SPAN + field->x[from] - x0);
    const int goal = (int)((field->y[to] - y0) * SPAN + field->x[to] - x0);
    queue[tail++] = (int16_t)start;
    came[start] = (int16_t)start;
    while (head < tail && came[goal] < 0) {
        const int cell = queue[head++], r = cell / SPAN, c = cell % SPAN;
        static const int step[4][2] = {{0, 1}, {0, -1}, {1, 0}, {-1, 0}};
        for (int k = 0; k < 4; k++) {
            const int nr = r + step[k][0], nc = c + step[k][1], next = nr * SPAN + nc;
            if (nr < 0 || nc < 0 || nr >= rows || nc >= columns || came[next] >= 0) continue;
            if (is_blocked(field, x0 + nc, y0 + nr)) continue;
            came[next] = (int16_t)cell;
            queue[tail++] = (int16_t)next;
        }
    }
    for (int cell = goal; cell != start; cell = came[cell]) way[length++] = (int16_t)cell;
    while (length-- > 0)
        if (string_add(string, centre_of(x0 + way[length] % SPAN, y0 + way[length] / SPAN)) < 0) return 0;
    return 1;
}

static int32_t find_near(const Field *field, const uint8_t *state, double goal_x, double goal_y, double tolerance, int64_t *cell) {
    double best = tolerance;
    int32_t found = -1;
    const int64_t reach = (int64_t)ceil(tolerance);
    for (int64_t y = (int64_t)floor(goal_y) - reach; y <= (int64_t)floor(goal_y) + reach; y++)
        for (int64_t x = (int64_t)floor(goal_x) - reach; x <= (int64_t)floor(goal_x) + reach; x++) {
            const double away = hypot((double)x + 0.5 - goal_x, (double)y + 0.5 - goal_y);
            if (away > best || is_blocked(field, x, y)) continue;
            const int32_t component = component_at(field, x, y);
            if (state[component] != CLOSED) continue;
            best = away;
            found = component;
            cell[0] = x;
            cell[1] = y;
        }
    return found;
}

enum { NO_MEMORY = -1, NO_WAY = -2, NO_ROOM = -3 };

/* The shortest path from `ends[0..1]` to `ends[2..3]` (x, y in cells) over a grid where `blocked` cells may not be entered.
 *
 * Where the goal's cell is blocked or out of reach, the path leads to the nearest reached cell within `tolerance` cells of it;
 * `ends` holds where it leads then. With `radius` > 0 it is pushed out to that distance from the squares of `occupied` cells,
 * where it has room. The start's cell must be free. Writes up to `capacity` points; returns their number, NO_WAY, NO_ROOM
 * where `capacity` is too small, or NO_MEMORY. */
int64_t shortest_path(const uint8_t *blocked, const uint8_t *occupied, int64_t height, int64_t width, double *ends,
                      double tolerance, double radius, double *path, int64_t capacity) {
    Field field;
    Search search = {0};
    String string = {0};
    int64_t result = NO_MEMORY;
    if (!field_build(&field, blocked, height, width)) goto done;
    const size_t n = (size_t)(field.components + 1);
    search.cost = malloc(n * sizeof(float));
    search.parent = malloc(n * sizeof(int32_t));
    search.state = malloc(n);
    search.bent = malloc(n);
    if (!search.cost || !search.parent || !search.state || !search.bent) goto done;
    const int64_t start_x = (int64_t)floor(ends[0]), start_y = (int64_t)floor(ends[1]);
    int64_t goal_cell[2] = {(int64_t)floor(ends[2]), (int64_t)floor(ends[3])};
    const int32_t start = component_at(&field, start_x, start_y);
    field.x[start] = (int32_t)start_x;
    field.y[start] = (int32_t)start_y;
    int32_t goal = is_blocked(&field, goal_cell[0], goal_cell[1]) ? -1 : component_at(&field, goal_cell[0], goal_cell[1]);
    const int together = goal == start;
    int found = 0;
    if (goal >= 0 && !together) {
        field.x[goal] = (int32_t)goal_cell[0];
        field.y[goal] = (int32_t)goal_cell[1];
        found = search_run(&field, &search, start, goal);
    } else {
        found = together;
        if (!together) {
            /* Nothing to head for: search all that can be reached, then choose. */
            memset(search.state, 0, n);
            int32_t *stack = search.parent;
            int64_t depth = 0;
            int32_t around[MAX_NEIGHBOURS];
            stack[depth++] = start;
            search.state[start] = CLOSED;
            while (depth > 0) {
                const int count = neighbours(&field, stack[--depth], around);
                for (int i = 0; i < count; i++)
                    if (search.state[around[i]] != CLOSED) {
                        search.state[around[i]] = CLOSED;
                        stack[depth++] = around[i];
                    }
            }
        }
    }
    if (found < 0) goto done;
    if (!found) {
        goal = tolerance > 0.0 ? find_near(&field, search.state, ends[2], ends[3], tolerance, goal_cell) : -1;
        if (goal < 0) {
            result = NO_WAY;
            goto done;
        }
        ends[2] = (double)goal_cell[0] + 0.5;
        ends[3] = (double)goal_cell[1] + 0.5;
        if (goal != start) {
            field.x[goal] = (int32_t)goal_cell[0];
            field.y[goal] = (int32_t)goal_cell[1];
            found = search_run(&field, &search, start, goal);
            if (found <= 0) {
                result = found < 0 ? NO_MEMORY : NO_WAY;
                goto done;
            }
        }
    }
    /* The chain of parents, from the start on. */
    int64_t nodes = 1;
    if (goal != start)
        for (int32_t i = goal; i != start; i = search.parent[i]) nodes++;
    int32_t *chain = malloc((size_t)nodes * sizeof(int32_t));
    if (!chain) goto done;
    int32_t at = goal;
    for (int64_t i = nodes - 1; i >= 0; i--) {
        chain[i] = at;
        if (i > 0) at = search.parent[at];
    }
    const Point first = {(int64_t)floor(ends[0] * UNIT), (int64_t)floor(ends[1] * UNIT)};
    const Point last = {(int64_t)floor(ends[2] * UNIT), (int64_t)floor(ends[3] * UNIT)};
    int whole = string_add(&string, first) >= 0 && string_add(&string, centre_of(start_x, start_y)) >= 0;
    for (int64_t i = 1; whole && i < nodes; i++) {
        if (search.bent[chain[i]])
            whole = append_bend(&field, &string, chain[i - 1], chain[i]);
        else
            whole = string_add(&string, centre_of(field.x[chain[i]], field.y[chain[i]])) >= 0;
    }
    free(chain);
    if (goal == start && whole) {
        /* Within one component the way may still bend: let the two cells stand for it in turn. */
        field.x[start] = (int32_t)start_x;
        field.y[start] = (int32_t)start_y;
        if (!sees(&field, (int32_t)start_x, (int32_t)start_y, (int32_t)goal_cell[0], (int32_t)goal_cell[1])) {
            Field shifted = field;
            int32_t twice_x[2] = {(int32_t)start_x, (int32_t)goal_cell[0]}, twice_y[2] = {(int32_t)start_y, (int32_t)goal_cell[1]};
            uint64_t masks[2] = {field.mask[start], field.mask[start]};
            int32_t blocks[2] = {field.block[start], field.block[start]};
            shifted.x = twice_x;
            shifted.y = twice_y;
            shifted.mask = masks;
            shifted.block = blocks;
            whole = append_bend(&shifted, &string, 0, 1);
        } else {
            whole = string_add(&string, centre_of(goal_cell[0], goal_cell[1])) >= 0;
        }
    }
    if (!whole || string_add(&string, last) < 0) goto done;
    for (int64_t i = 0; i < string.count; i++) {
        string.knots[i].before = (int32_t)(i - 1);
        string.knots[i].after = i + 1 < string.count ? (int32_t)(i + 1) : -1;
    }
    const int32_t end = (int32_t)(string.count - 1);
    if (!tighten(&string, blocked, height, width, 0, end)) goto done;
    int64_t count = 0;
    Place *places = (Place *)path;
    for (int32_t i = 0; i >= 0; i = string.knots[i].after) {
        if (count == capacity) {
            result = NO_ROOM;
            goto done;
        }
        places[count++] = (Place){(double)string.knots[i].at.x / UNIT, (double)string.knots[i].at.y / UNIT};
    }
    places[0] = (Place){ends[0], ends[1]};
    places[count - 1] = (Place){ends[2], ends[3]};
    result = count;
    if (radius > 0.0) {
        Place *moved = malloc((size_t)capacity * sizeof(Place));
        if (moved) {
            memcpy(moved, places, (size_t)count * sizeof(Place));
            const int64_t pushed = lay_round(occupied, height, width, moved, count, capacity, radius);
            if (pushed > 0) {
                memcpy(places, moved, (size_t)pushed * sizeof(Place));
                result = pushed;
            }
            free(moved);
        }
    }
done:
    free(string.knots);
    free(string.hull);
    free(search.cost);
    free(search.parent);
    free(search.state);
    free(search.bent);
    free(search.heap.entries);
    field_free(&field);
    return result;
}
