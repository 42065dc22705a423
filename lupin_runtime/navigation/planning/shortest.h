/* The shortest path of any angle over a grid of blocked cells.
 *
 * The grid is cut into blocks of 8 x 8 cells, one 64-bit word each. Each connected part of a block is one node, so that even
 * the thinnest wall is kept, while a map of four million cells has only some ten thousand nodes. Lazy Theta* (Nash, Koenig &
 * Tovey 2010) finds the path around the obstacles over these nodes; its line-of-sight checks run on the cells and jump over
 * free blocks. Then the string is pulled tight on the cells, exactly, in integers. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "blocks.h"
#include "path_shortening.h"

enum { OPEN = 1, CLOSED = 2 };

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
    uint8_t *bent;    /* the parent is a neighbor that is not in sight */
    Heap heap;
} Search;

static float apart(const Field *field, int32_t a, int32_t b) {
    const float dx = (float)(field->x[a] - field->x[b]), dy = (float)(field->y[a] - field->y[b]);
    return sqrtf(dx * dx + dy * dy);
}

static int sees_node(const Field *field, int32_t a, int32_t b) {
    return sees(field, field->x[a], field->y[a], field->x[b], field->y[b]);
}

/* Replaces a parent that was assumed to be in sight, but is not, by the best of the closed neighbors and their parents. */
static void reconsider(const Field *field, Search *search, int32_t node, const int32_t *around, int count) {
    float costs[2 * MAX_NEIGHBORS];
    int32_t parents[2 * MAX_NEIGHBORS];
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
    /* Connected around a bend within the two blocks: an estimate of its length will do, as the string is pulled tight later. */
    search->parent[node] = nearest;
    search->cost[node] = search->cost[nearest] + 1.3f * apart(field, nearest, node);
    search->bent[node] = 1;
}

/* Returns 1 with the chain of parents filled, 0 if the goal cannot be reached, -1 if memory runs out. */
static int search_run(const Field *field, Search *search, int32_t start, int32_t goal) {
    int32_t around[MAX_NEIGHBORS];
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
        const int count = neighbors(field, node, around);
        if (search->parent[node] >= 0 && !search->bent[node] && !sees_node(field, search->parent[node], node)) {
            reconsider(field, search, node, around, count);
            const float key = search->cost[node] + apart(field, node, goal);
            if (search->heap.count && key > search->heap.entries[0].key) {
                if (!heap_push(&search->heap, key, node)) return -1;
                /* Its parent is in sight now; when the node is expanded again, the check is quick or a better parent is known. */
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
static Point center_of(int64_t x, int64_t y) { return (Point){x * UNIT + UNIT / 2, y * UNIT + UNIT / 2}; }

/* Appends the cells from one node to one in a neighboring block that it does not see: breadth first through the free cells of
 * the rectangle that contains both blocks. Returns 0 if memory runs out. */
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
        if (string_add(string, center_of(x0 + way[length] % SPAN, y0 + way[length] / SPAN)) < 0) return 0;
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

/* Finds the shortest path from `ends[0..1]` to `ends[2..3]` (x, y in cells) over a grid whose `blocked` cells may not be
 * entered.
 *
 * If the goal's cell is blocked or out of reach, the path leads to the nearest reachable cell within `tolerance` cells of it,
 * and `ends` is set to that cell. With `radius` > 0 the path is pushed out to that distance from the squares of `occupied`
 * cells, if there is room. The start's cell must be free. Writes up to `capacity` points; returns their number, NO_WAY, NO_ROOM
 * if `capacity` is too small, or NO_MEMORY. */
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
            /* The goal is blocked: find all that can be reached, then choose. */
            memset(search.state, 0, n);
            int32_t *stack = search.parent;
            int64_t depth = 0;
            int32_t around[MAX_NEIGHBORS];
            stack[depth++] = start;
            search.state[start] = CLOSED;
            while (depth > 0) {
                const int count = neighbors(&field, stack[--depth], around);
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
    int whole = string_add(&string, first) >= 0 && string_add(&string, center_of(start_x, start_y)) >= 0;
    for (int64_t i = 1; whole && i < nodes; i++) {
        if (search.bent[chain[i]])
            whole = append_bend(&field, &string, chain[i - 1], chain[i]);
        else
            whole = string_add(&string, center_of(field.x[chain[i]], field.y[chain[i]])) >= 0;
    }
    free(chain);
    if (goal == start && whole) {
        /* Within one component the path may still bend: use each of the two cells as its representative in turn. */
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
            whole = string_add(&string, center_of(goal_cell[0], goal_cell[1])) >= 0;
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
    Vec2 *places = (Vec2 *)path;
    for (int32_t i = 0; i >= 0; i = string.knots[i].after) {
        if (count == capacity) {
            result = NO_ROOM;
            goto done;
        }
        places[count++] = (Vec2){(double)string.knots[i].at.x / UNIT, (double)string.knots[i].at.y / UNIT};
    }
    places[0] = (Vec2){ends[0], ends[1]};
    places[count - 1] = (Vec2){ends[2], ends[3]};
    result = count;
    if (radius > 0.0) {
        Vec2 *moved = malloc((size_t)capacity * sizeof(Vec2));
        if (moved) {
            memcpy(moved, places, (size_t)count * sizeof(Vec2));
            const int64_t pushed = lay_round(occupied, height, width, moved, count, capacity, radius);
            if (pushed > 0) {
                memcpy(places, moved, (size_t)pushed * sizeof(Vec2));
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
