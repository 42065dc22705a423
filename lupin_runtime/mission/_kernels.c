/* What a camera on the robot sees of a grid map's surfaces, and the travel distance to every cell.
 *
 * Grids are int8 (height, width), row 0 at the lowest y; -1 unknown, 0 free .. 100 occupied. Lengths are meters.
 * A surface is a row of 4 doubles (x, y, nx, ny): the center of the free cell in front of it and its outward unit normal.
 * A pose is a row of 4 doubles (x, y, yaw, weight).
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    double resolution, origin_x, origin_y;
    double camera_x, min_range, max_range, cos_half_fov, cos_incidence, min_facing;
    int32_t height, width, occupied_thresh;
} View;

/* Returns whether the line between two points crosses only known cells without obstacles. The first 0.1 m are
 * skipped: the camera cannot be inside an obstacle, even if the map is off by a cell. */
static int line_is_clear(const int8_t *cells, const View *v, double x0, double y0, double x1, double y1)
{
    const double length = hypot(x1 - x0, y1 - y0);
    const int steps = (int)(2.0 * length / v->resolution) + 1;
    const int first = (int)(0.10 / length * steps) + 1;
    for (int i = first; i <= steps; i++) {
        const double f = (double)i / steps;
        const int column = (int)floor((x0 + f * (x1 - x0) - v->origin_x) / v->resolution);
        const int row = (int)floor((y0 + f * (y1 - y0) - v->origin_y) / v->resolution);
        if (row < 0 || row >= v->height || column < 0 || column >= v->width)
            return 0;
        const int8_t value = cells[(int64_t)row * v->width + column];
        if (value < 0 || value >= v->occupied_thresh)
            return 0;
    }
    return 1;
}

/* Returns whether a camera at (cx, cy) that looks along (ux, uy) sees surface s. */
static int sees(const int8_t *cells, const View *v, double cx, double cy, double ux, double uy, const double *s)
{
    const double dx = s[0] - cx, dy = s[1] - cy;
    const double square = dx * dx + dy * dy;
    if (square > v->max_range * v->max_range || square < v->min_range * v->min_range)
        return 0;
    const double range = sqrt(square);
    if (dx * ux + dy * uy < v->cos_half_fov * range)
        return 0;
    const double facing = -(dx * s[2] + dy * s[3]) / range; /* cosine of the incidence */
    if (facing < v->cos_incidence || facing < v->min_facing * range)
        return 0;
    return line_is_clear(cells, v, cx, cy, s[0], s[1]);
}

/* Adds to seen[i] the weights of the poses that see surface i. */
void add_view_time(const int8_t *cells, const View *v, const double *surfaces, int64_t n, const double *poses, int64_t m,
                   double *seen)
{
    for (int64_t j = 0; j < m; j++) {
        const double *p = poses + 4 * j;
        const double ux = cos(p[2]), uy = sin(p[2]);
        const double cx = p[0] + v->camera_x * ux, cy = p[1] + v->camera_x * uy;
        for (int64_t i = 0; i < n; i++)
            if (sees(cells, v, cx, cy, ux, uy, surfaces + 4 * i))
                seen[i] += p[3];
    }
}

/* Sets gain[j] to the sum of the weights of the surfaces that pose j sees. */
void view_gain(const int8_t *cells, const View *v, const double *surfaces, const double *weights, int64_t n,
               const double *poses, int64_t m, double *gain)
{
    for (int64_t j = 0; j < m; j++) {
        const double *p = poses + 4 * j;
        const double ux = cos(p[2]), uy = sin(p[2]);
        const double cx = p[0] + v->camera_x * ux, cy = p[1] + v->camera_x * uy;
        double sum = 0.0;
        for (int64_t i = 0; i < n; i++)
            if (weights[i] > 0.0 && sees(cells, v, cx, cy, ux, uy, surfaces + 4 * i))
                sum += weights[i];
        gain[j] = sum;
    }
}

/* Sets visible[j * n + i] to 1 if pose j sees surface i, else 0. */
void view_matrix(const int8_t *cells, const View *v, const double *surfaces, int64_t n, const double *poses, int64_t m,
                 uint8_t *visible)
{
    for (int64_t j = 0; j < m; j++) {
        const double *p = poses + 4 * j;
        const double ux = cos(p[2]), uy = sin(p[2]);
        const double cx = p[0] + v->camera_x * ux, cy = p[1] + v->camera_x * uy;
        for (int64_t i = 0; i < n; i++)
            visible[j * n + i] = (uint8_t)sees(cells, v, cx, cy, ux, uy, surfaces + 4 * i);
    }
}

/* Computes travel distances in cells from (row, column) over cells with passable != 0, 8-connected without cutting corners;
 * INFINITY for cells that no path reaches. Dial's buckets on chamfer weights 5 and 7 (Borgefors 1986: within 4 % of Euclid's).
 * Returns 0, or -1 if memory runs out. */
int32_t travel_distance(const uint8_t *passable, int32_t height, int32_t width, int32_t row, int32_t column, float *distance)
{
    static const int dr[8] = {0, 0, 1, -1, 1, 1, -1, -1}, dc[8] = {1, -1, 0, 0, 1, -1, 1, -1};
    enum { RING = 8, UNSEEN = INT32_MAX };
    const int64_t size = (int64_t)height * width;
    int32_t *cost = malloc((size_t)size * sizeof *cost);
    int32_t *buckets[RING];
    int64_t used[RING] = {0}, room[RING];
    int failed = cost == NULL;
    for (int k = 0; k < RING; k++) {
        room[k] = 1024;
        buckets[k] = malloc((size_t)room[k] * sizeof **buckets);
        failed |= buckets[k] == NULL;
    }
    if (!failed) {
        for (int64_t i = 0; i < size; i++)
            cost[i] = UNSEEN;
        const int32_t start = row * width + column;
        cost[start] = 0;
        buckets[0][used[0]++] = start;
        int empty = 0;
        for (int32_t now = 0; empty < RING && !failed; now++) {
            const int slot = now % RING;
            empty = used[slot] ? 0 : empty + 1;
            while (used[slot] > 0 && !failed) {
                const int32_t cell = buckets[slot][--used[slot]];
                if (cost[cell] != now)
                    continue;
                const int r = cell / width, c = cell % width;
                for (int k = 0; k < 8; k++) {
                    const int nr = r + dr[k], nc = c + dc[k];
                    if (nr < 0 || nr >= height || nc < 0 || nc >= width || !passable[(int64_t)nr * width + nc])
                        continue;
                    if (k >= 4 && (!passable[(int64_t)r * width + nc] || !passable[(int64_t)nr * width + c]))
                        continue;
                    const int32_t next = now + (k < 4 ? 5 : 7);
                    const int32_t to = nr * width + nc;
                    if (next >= cost[to])
                        continue;
                    cost[to] = next;
                    const int into = next % RING;
                    if (used[into] == room[into]) {
                        int32_t *more = realloc(buckets[into], (size_t)(2 * room[into]) * sizeof *more);
                        if (more == NULL) {
                            failed = 1;
                            break;
                        }
                        buckets[into] = more;
                        room[into] *= 2;
                    }
                    buckets[into][used[into]++] = to;
                }
            }
        }
        for (int64_t i = 0; i < size && !failed; i++)
            distance[i] = cost[i] == UNSEEN ? INFINITY : (float)cost[i] / 5.0f;
    }
    for (int k = 0; k < RING; k++)
        free(buckets[k]);
    free(cost);
    return failed ? -1 : 0;
}
