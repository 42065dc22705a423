/* Kernels of the costmaps: scan evidence by ray tracing, and the exact distance to the nearest lethal cell with its cost. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define SIMD __attribute__((target_clones("avx2", "default")))
#else
#define SIMD
#endif

enum { FREE = 0, INSCRIBED = 253, LETHAL = 254, UNKNOWN = 255 };

typedef struct {
    uint8_t *evidence; /* 0: no obstacle; counts down while beams pass through */
    uint8_t *touched;  /* scratch of the grid's size: 1 passed, 2 hit by this scan */
    int64_t height, width;
    uint8_t miss;
} Layer;

static inline void pass_cell(Layer *layer, int64_t row, int64_t column) {
    if (row < 0 || column < 0 || row >= layer->height || column >= layer->width) return;
    const int64_t at = row * layer->width + column;
    if (layer->touched[at]) return;
    layer->touched[at] = 1;
    layer->evidence[at] = layer->evidence[at] > layer->miss ? (uint8_t)(layer->evidence[at] - layer->miss) : 0;
}

/* Visits the cells of a ray from (x0, y0) to (x1, y1), in cells, without the last one (Amanatides & Woo 1987). */
static void clear_ray(Layer *layer, double x0, double y0, double x1, double y1) {
    int64_t column = (int64_t)floor(x0), row = (int64_t)floor(y0);
    const int64_t end_column = (int64_t)floor(x1), end_row = (int64_t)floor(y1);
    const double dx = x1 - x0, dy = y1 - y0;
    const int64_t step_x = dx > 0 ? 1 : -1, step_y = dy > 0 ? 1 : -1;
    const double delta_x = dx != 0 ? fabs(1.0 / dx) : INFINITY, delta_y = dy != 0 ? fabs(1.0 / dy) : INFINITY;
    double next_x = dx > 0 ? (floor(x0) + 1.0 - x0) * delta_x : dx < 0 ? (x0 - floor(x0)) * delta_x : INFINITY;
    double next_y = dy > 0 ? (floor(y0) + 1.0 - y0) * delta_y : dy < 0 ? (y0 - floor(y0)) * delta_y : INFINITY;
    int64_t cells = llabs(end_column - column) + llabs(end_row - row);
    while (cells-- > 0) {
        pass_cell(layer, row, column);
        if (next_x < next_y) {
            next_x += delta_x;
            column += step_x;
        } else {
            next_y += delta_y;
            row += step_y;
        }
    }
}

/* Adds one scan to the evidence. geometry: origin_x, origin_y, cell size. sensor: x, y, yaw at the first beam, then at the
 * last one: the robot turns by up to 0.2 rad during a revolution of the mirror. limits: nearest, farthest mark, farthest clear,
 * m. Beams that are NaN, infinite or nearer than the limit are ignored. Returns the number of usable beams. */
int64_t trace_scan(uint8_t *evidence, uint8_t *touched, int64_t height, int64_t width, const double *geometry,
                   const float *ranges, int64_t beams, double angle_min, double angle_increment, const double *sensor,
                   const double *limits, uint8_t hit, uint8_t miss) {
    Layer layer = {evidence, touched, height, width, miss};
    const double inverse = 1.0 / geometry[2];
    double turn = sensor[5] - sensor[2];
    turn -= 2.0 * M_PI * round(turn / (2.0 * M_PI));
    int64_t valid = 0;
    memset(touched, 0, (size_t)(height * width));
    /* Hits first, so that no beam of the same scan clears a cell that another one hit. */
    for (int pass = 0; pass < 2; pass++) {
        for (int64_t i = 0; i < beams; i++) {
            const double range = ranges[i];
            if (!(range >= limits[0] && range < INFINITY)) continue;
            if (pass == 0) valid++;
            const double reach = pass == 0 ? limits[1] : limits[2];
            if (pass == 0 && range > reach) continue;
            const double along = beams > 1 ? (double)i / (double)(beams - 1) : 0.0;
            const double x = sensor[0] + along * (sensor[3] - sensor[0]), y = sensor[1] + along * (sensor[4] - sensor[1]);
            const double angle = sensor[2] + along * turn + angle_min + (double)i * angle_increment;
            const double length = range < reach ? range : reach;
            const double end_x = (x + length * cos(angle) - geometry[0]) * inverse;
            const double end_y = (y + length * sin(angle) - geometry[1]) * inverse;
            if (pass == 0) {
                const int64_t column = (int64_t)floor(end_x), row = (int64_t)floor(end_y);
                if (row < 0 || column < 0 || row >= height || column >= width) continue;
                evidence[row * width + column] = hit;
                touched[row * width + column] = 2;
            } else {
                clear_ray(&layer, (x - geometry[0]) * inverse, (y - geometry[1]) * inverse, end_x, end_y);
            }
        }
    }
    return valid;
}

/* Computes the squared distance along a row to the nearest set cell, in cells or, with `edges`, in half cells to its edge.
 * Returns whether the row has a set cell. */
static int row_pass(const uint8_t *row, int64_t width, int reach, int edges, uint16_t *out) {
    const int far = reach + 1;
    int gap = far, any = 0;
    for (int64_t x = 0; x < width; x++) {
        gap = row[x] ? 0 : gap < far ? gap + 1 : far;
        any |= row[x];
        out[x] = (uint16_t)gap;
    }
    gap = far;
    for (int64_t x = width - 1; x >= 0; x--) {
        gap = row[x] ? 0 : gap < far ? gap + 1 : far;
        const int g = gap < out[x] ? gap : out[x];
        const int scaled = edges ? (g > 0 ? 2 * g - 1 : 0) : g;
        out[x] = (uint16_t)(scaled * scaled);
    }
    return any;
}

SIMD static void column_pass(uint16_t *restrict best, const uint16_t *restrict squares, uint16_t offset, int64_t width) {
    for (int64_t x = 0; x < width; x++) {
        const uint16_t candidate = (uint16_t)(squares[x] + offset);
        best[x] = candidate < best[x] ? candidate : best[x];
    }
}

/* Computes the squared distance of every cell's center to the nearest set cell, exact up to `reach` cells, saturated beyond.
 * edges = 0: to the set cell's center, in cells. edges = 1: to its square, in half cells (reach up to 90).
 * Two separable passes (Saito & Toriwaki 1994), the second one cut at the reach. Returns 0, or -1 if memory runs out. */
int64_t squared_distances(const uint8_t *set, int64_t height, int64_t width, int64_t reach, int64_t edges, uint16_t *out) {
    uint16_t *squares = malloc((size_t)(height * width) * sizeof(uint16_t));
    uint8_t *any = malloc((size_t)height);
    if (!squares || !any) {
        free(squares);
        free(any);
        return -1;
    }
    for (int64_t y = 0; y < height; y++)
        any[y] = (uint8_t)(row_pass(set + y * width, width, (int)reach, (int)edges, squares + y * width) != 0);
    const int far = edges ? (int)(2 * reach + 1) : (int)(reach + 1);
    const uint16_t saturated = (uint16_t)(far * far);
    for (int64_t y = 0; y < height; y++) {
        uint16_t *best = out + y * width;
        for (int64_t x = 0; x < width; x++) best[x] = saturated;
        const int64_t low = y > reach ? y - reach : 0, high = y + reach < height ? y + reach : height - 1;
        for (int64_t other = low; other <= high; other++) {
            if (!any[other]) continue;
            const int dy = (int)llabs(other - y), scaled = edges ? (dy > 0 ? 2 * dy - 1 : 0) : dy;
            column_pass(best, squares + other * width, (uint16_t)(scaled * scaled), width);
        }
    }
    free(squares);
    free(any);
    return 0;
}

/* Looks up costs and distances from squared distances. `cost_of` and `meters_of` are tables over the squared distance in cells.
 * Unknown cells stay unknown unless an obstacle is within the inscribed radius, as in Nav2's inflation layer. */
void look_up_costs(const uint8_t *base, const uint16_t *squares, int64_t cells, const uint8_t *cost_of,
                   const float *meters_of, uint8_t *cost, float *meters) {
    for (int64_t i = 0; i < cells; i++) {
        const uint8_t inflated = cost_of[squares[i]];
        meters[i] = meters_of[squares[i]];
        cost[i] = base[i] == UNKNOWN ? (inflated >= INSCRIBED ? inflated : UNKNOWN)
                                     : (inflated > base[i] ? inflated : base[i]);
    }
}
