/* The hot loops of mapping and localization. Poses are (x, y, yaw) triples of doubles in meters and radians; rasters are
 * row-major with row 0 at the lowest y, `x0, y0` the outer corner of cell (0, 0). Callers check shapes (kernels.py). */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define MAX_SIDE 8 /* neighbors on each side that a normal is fitted to */

/* ---- scans ------------------------------------------------------------------------------------------------------- */

/* Normals of scan points in beam order, towards the sensor at (sx, sy); (0, 0) where no line fits.
 * `step` is the angle between beams: neighbors join while their gap is what a slanted wall at that range may show. */
void scan_normals(const double *xy, int n, double sx, double sy, double step, double *normal)
{
    for (int i = 0; i < n; i++) {
        normal[2 * i] = normal[2 * i + 1] = 0.0;
        double px = xy[2 * i], py = xy[2 * i + 1];
        double range = hypot(px - sx, py - sy);
        double gap = 0.10 + 4.0 * step * range, reach = fmax(0.15, 3.5 * step * range);
        double sum_x = px, sum_y = py;
        int low = i, high = i;
        while (low > 0 && i - low < MAX_SIDE) {
            double dx = xy[2 * low - 2] - xy[2 * low], dy = xy[2 * low - 1] - xy[2 * low + 1];
            if (dx * dx + dy * dy > gap * gap || hypot(xy[2 * low - 2] - px, xy[2 * low - 1] - py) > reach)
                break;
            low--;
            sum_x += xy[2 * low];
            sum_y += xy[2 * low + 1];
        }
        while (high < n - 1 && high - i < MAX_SIDE) {
            double dx = xy[2 * high + 2] - xy[2 * high], dy = xy[2 * high + 3] - xy[2 * high + 1];
            if (dx * dx + dy * dy > gap * gap || hypot(xy[2 * high + 2] - px, xy[2 * high + 3] - py) > reach)
                break;
            high++;
            sum_x += xy[2 * high];
            sum_y += xy[2 * high + 1];
        }
        int count = high - low + 1;
        if (count < 3)
            continue;
        double mx = sum_x / count, my = sum_y / count, xx = 0.0, xy_ = 0.0, yy = 0.0;
        for (int k = low; k <= high; k++) {
            double dx = xy[2 * k] - mx, dy = xy[2 * k + 1] - my;
            xx += dx * dx;
            xy_ += dx * dy;
            yy += dy * dy;
        }
        double middle = 0.5 * (xx + yy), spread = hypot(0.5 * (xx - yy), xy_);
        double small = middle - spread, large = middle + spread;
        if (large <= 0.0 || small > 0.06 * large || small / count > 0.04 * 0.04)
            continue;
        double along = 0.5 * atan2(2.0 * xy_, xx - yy);
        double nx = -sin(along), ny = cos(along);
        if (nx * (sx - px) + ny * (sy - py) < 0.0) {
            nx = -nx;
            ny = -ny;
        }
        normal[2 * i] = nx;
        normal[2 * i + 1] = ny;
    }
}

/* ---- local maps: surfels and a field of likelihood ------------------------------------------------------------------ */

/* A surfel is the mean of the points of one cell that face one way: x, y, nx, ny, count. A cell holds up to two, so that
 * both faces of a thin wall or table keep their own. */
#define SURFEL 5

/* Adds the points of `sets` scans, each at its own pose, to the surfels; marks every touched cell in `marks` (its list).
 * Returns the number of surfels; `mark_count` receives the number of marked cells. Points outside the raster are skipped. */
int add_surfels(const double *xy, const double *normal, const int64_t *start, const int64_t *count, const double *poses,
                int sets, double x0, double y0, double cell, int width, int height, int32_t *slot, double *surfel,
                int surfels, uint8_t *marked, int32_t *marks, int32_t *mark_count)
{
    int listed = *mark_count;
    for (int s = 0; s < sets; s++) {
        double tx = poses[3 * s], ty = poses[3 * s + 1], c = cos(poses[3 * s + 2]), sn = sin(poses[3 * s + 2]);
        for (int64_t k = start[s]; k < start[s] + count[s]; k++) {
            double x = tx + c * xy[2 * k] - sn * xy[2 * k + 1], y = ty + sn * xy[2 * k] + c * xy[2 * k + 1];
            int col = (int)floor((x - x0) / cell), row = (int)floor((y - y0) / cell);
            if (col < 0 || row < 0 || col >= width || row >= height)
                continue;
            int at = row * width + col;
            if (!marked[at]) {
                marked[at] = 1;
                marks[listed++] = at;
            }
            double nx = c * normal[2 * k] - sn * normal[2 * k + 1], ny = sn * normal[2 * k] + c * normal[2 * k + 1];
            if (nx == 0.0 && ny == 0.0)
                continue;
            for (int side = 0; side < 2; side++) {
                int32_t *entry = &slot[2 * at + side];
                if (*entry < 0) {
                    *entry = surfels++;
                    memset(&surfel[SURFEL * *entry], 0, SURFEL * sizeof(double));
                }
                double *f = &surfel[SURFEL * *entry];
                double dot = f[2] * nx + f[3] * ny;
                if (f[4] > 0.0 && dot < 0.3 * f[4])
                    continue;
                f[0] += x;
                f[1] += y;
                f[2] += nx;
                f[3] += ny;
                f[4] += 1.0;
                break;
            }
        }
    }
    *mark_count = listed;
    return surfels;
}

/* Turns sums into means; a surfel whose normals disagree loses its normal. */
void finish_surfels(double *surfel, int surfels)
{
    for (int i = 0; i < surfels; i++) {
        double *f = &surfel[SURFEL * i];
        if (f[4] <= 0.0)
            continue;
        f[0] /= f[4];
        f[1] /= f[4];
        double length = hypot(f[2], f[3]);
        double keep = length > 0.7 * f[4] ? 1.0 / length : 0.0;
        f[2] *= keep;
        f[3] *= keep;
    }
}

/* Draws `stamp` (2 reach + 1 squared) around every marked cell into `field`, keeping maxima. */
void draw_field(const int32_t *marks, int count, const uint8_t *stamp, int reach, uint8_t *field, int width, int height)
{
    int size = 2 * reach + 1;
    for (int i = 0; i < count; i++) {
        int col = marks[i] % width, row = marks[i] / width;
        for (int r = -reach; r <= reach; r++) {
            if (row + r < 0 || row + r >= height)
                continue;
            uint8_t *line = field + (int64_t)(row + r) * width;
            const uint8_t *from = stamp + (r + reach) * size + reach;
            for (int k = -reach; k <= reach; k++)
                if (col + k >= 0 && col + k < width && from[k] > line[col + k])
                    line[col + k] = from[k];
        }
    }
}

/* Levels 1..levels-1 of `pyramid` from level 0: cell (x, y) of level h is the maximum over [x, x + 2^h) x [y, y + 2^h). */
void build_pyramid(uint8_t *pyramid, int levels, int width, int height)
{
    int64_t area = (int64_t)width * height;
    for (int level = 1; level < levels; level++) {
        const uint8_t *low = pyramid + (level - 1) * area;
        uint8_t *high = pyramid + level * area;
        int half = 1 << (level - 1);
        for (int row = 0; row < height; row++) {
            const uint8_t *a = low + (int64_t)row * width;
            const uint8_t *b = row + half < height ? a + (int64_t)half * width : a;
            uint8_t *out = high + (int64_t)row * width;
            for (int col = 0; col < width; col++)
                out[col] = a[col] > b[col] ? a[col] : b[col];
            for (int col = 0; col + half < width; col++)
                out[col] = out[col] > out[col + half] ? out[col] : out[col + half];
        }
    }
}

/* ---- correlative search: branch and bound over a window of poses ------------------------------------------------------
 * Olson, "Real-time correlative scan matching", ICRA 2009; bounds from max-pooled levels as in Hess et al., ICRA 2016. */

typedef struct {
    float bound;
    int angle, col, row;
} Candidate;

typedef struct {
    const uint8_t *pyramid;
    int width, height, n, half;
    int64_t area;
    const int32_t *cells; /* angles x n x 2, cells of the points with the window's center as offset */
    const double *yaw_penalty;
    double place_penalty; /* per squared cell of distance from the window's center */
    const int32_t *avoid; /* avoided x 5: angle, col, row, and how far around each in angles and cells */
    int avoided;
    float best;
    Candidate found;
} Search;

static float bound_of(const Search *q, const Candidate *at, int level)
{
    const uint8_t *field = q->pyramid + level * q->area;
    const int32_t *p = q->cells + (int64_t)at->angle * q->n * 2;
    uint32_t sum = 0;
    for (int i = 0; i < q->n; i++) {
        unsigned col = (unsigned)(p[2 * i] + at->col), row = (unsigned)(p[2 * i + 1] + at->row);
        if (col < (unsigned)q->width && row < (unsigned)q->height)
            sum += field[row * (unsigned)q->width + col];
    }
    int span = (1 << level) - 1;
    int dc = at->col > 0 ? at->col : at->col + span < 0 ? -(at->col + span) : 0;
    int dr = at->row > 0 ? at->row : at->row + span < 0 ? -(at->row + span) : 0;
    return (float)(sum / (255.0 * q->n) - q->place_penalty * (dc * dc + dr * dr) - q->yaw_penalty[at->angle]);
}

static int by_bound(const void *a, const void *b)
{
    float x = ((const Candidate *)a)->bound, y = ((const Candidate *)b)->bound;
    return x < y ? 1 : x > y ? -1 : 0;
}

static int is_avoided(const Search *q, const Candidate *at)
{
    for (const int32_t *a = q->avoid; a < q->avoid + 5 * q->avoided; a += 5)
        if (abs(at->angle - a[0]) <= a[3] && abs(at->col - a[1]) <= a[4] && abs(at->row - a[2]) <= a[4])
            return 1;
    return 0;
}

static void descend(Search *q, Candidate *list, int count, int level)
{
    qsort(list, count, sizeof(Candidate), by_bound);
    for (int i = 0; i < count && list[i].bound > q->best; i++) {
        Candidate *at = &list[i];
        if (level == 0) {
            if (is_avoided(q, at))
                continue;
            q->best = at->bound;
            q->found = *at;
            return;
        }
        Candidate child[4];
        int children = 0, step = 1 << (level - 1);
        for (int k = 0; k < 4; k++) {
            Candidate c = {0.0f, at->angle, at->col + (k & 1) * step, at->row + (k >> 1) * step};
            if (c.col > q->half || c.row > q->half)
                continue;
            c.bound = bound_of(q, &c, level - 1);
            if (c.bound > q->best)
                child[children++] = c;
        }
        descend(q, child, children, level - 1);
    }
}

/* The best offset within +-half cells and the listed angles. `xy` are points around the pose's origin; the raster's level 0
 * must be empty within 2^(levels-1) cells of its border. Returns 0 if nothing beats `floor`; `found` is angle, col, row.
 * -1: out of memory. */
int search_window(const uint8_t *pyramid, int levels, int width, int height, double x0, double y0, double cell,
                  const double *xy, int n, double cx, double cy, const double *yaws, const double *yaw_penalty, int angles,
                  int half, double place_penalty, double floor_score, const int32_t *avoid, int avoided,
                  int32_t *found, double *score)
{
    int top = levels - 1, stride = 1 << top;
    int across = (2 * half) / stride + 1;
    int32_t *cells = malloc((size_t)angles * n * 2 * sizeof(int32_t));
    Candidate *list = malloc((size_t)angles * across * across * sizeof(Candidate));
    if (!cells || !list) {
        free(cells);
        free(list);
        return -1;
    }
    Search q = {pyramid, width, height, n, half, (int64_t)width * height, cells, yaw_penalty, place_penalty,
                avoid, avoided, (float)floor_score, {0, 0, 0, 0}};
    int count = 0;
    for (int a = 0; a < angles; a++) {
        double c = cos(yaws[a]), s = sin(yaws[a]);
        int32_t *p = cells + (int64_t)a * n * 2;
        for (int i = 0; i < n; i++) {
            p[2 * i] = (int32_t)floor((cx + c * xy[2 * i] - s * xy[2 * i + 1] - x0) / cell);
            p[2 * i + 1] = (int32_t)floor((cy + s * xy[2 * i] + c * xy[2 * i + 1] - y0) / cell);
        }
        for (int r = 0; r < across; r++)
            for (int k = 0; k < across; k++) {
                Candidate at = {0.0f, a, -half + k * stride, -half + r * stride};
                at.bound = bound_of(&q, &at, top);
                if (at.bound > q.best)
                    list[count++] = at;
            }
    }
    descend(&q, list, count, top);
    free(cells);
    free(list);
    if (q.best <= (float)floor_score)
        return 0;
    found[0] = q.found.angle;
    found[1] = q.found.col;
    found[2] = q.found.row;
    *score = q.best;
    return 1;
}

/* Mean of the field (0..1) under the points at a pose. */
double field_score(const uint8_t *field, int width, int height, double x0, double y0, double cell, const double *xy, int n,
                   const double *pose)
{
    double c = cos(pose[2]), s = sin(pose[2]);
    uint32_t sum = 0;
    for (int i = 0; i < n; i++) {
        int col = (int)floor((pose[0] + c * xy[2 * i] - s * xy[2 * i + 1] - x0) / cell);
        int row = (int)floor((pose[1] + s * xy[2 * i] + c * xy[2 * i + 1] - y0) / cell);
        if (col >= 0 && row >= 0 && col < width && row < height)
            sum += field[(int64_t)row * width + col];
    }
    return n ? sum / (255.0 * n) : 0.0;
}

/* ---- refinement: point to line ------------------------------------------------------------------------------------- */

static int solve3(const double *h, const double *b, double *x)
{
    double a[9];
    memcpy(a, h, sizeof a);
    double det = a[0] * (a[4] * a[8] - a[5] * a[7]) - a[1] * (a[3] * a[8] - a[5] * a[6]) + a[2] * (a[3] * a[7] - a[4] * a[6]);
    if (!(fabs(det) > 1e-300))
        return 0;
    x[0] = (b[0] * (a[4] * a[8] - a[5] * a[7]) - a[1] * (b[1] * a[8] - a[5] * b[2]) + a[2] * (b[1] * a[7] - a[4] * b[2])) / det;
    x[1] = (a[0] * (b[1] * a[8] - a[5] * b[2]) - b[0] * (a[3] * a[8] - a[5] * a[6]) + a[2] * (a[3] * b[2] - b[1] * a[6])) / det;
    x[2] = (a[0] * (a[4] * b[2] - b[1] * a[7]) - a[1] * (a[3] * b[2] - b[1] * a[6]) + b[0] * (a[3] * a[7] - a[4] * a[6])) / det;
    return 1;
}

/* Gauss-Newton on `pose`: distances of the points to the lines of their nearest surfels, under a Cauchy kernel, and a prior.
 * The gate shrinks from `gate` to `gate_end` meters. `sigma_of` (n) is each point's own standard deviation.
 * Receives the measurement's information (without prior) in `info`, and inliers, weighted square sum, mean |r| in `stats`.
 * Returns the number of points with a partner. */
int refine_pose(const double *xy, const double *normal, const double *sigma_of, int n, const int32_t *slot,
                const double *surfel, double x0, double y0, double cell, int width, int height, double *pose,
                const double *prior, const double *prior_info, int iterations, double gate, double gate_end, double *info,
                double *stats)
{
    double shrink = iterations > 1 ? pow(gate_end / gate, 1.0 / (iterations - 1)) : 1.0;
    int partners = 0;
    for (int iteration = 0; iteration < iterations; iteration++) {
        double h[9] = {0}, b[3] = {0}, c = cos(pose[2]), s = sin(pose[2]), total = 0.0, absolute = 0.0;
        int reach = (int)ceil(gate / cell), inliers = 0;
        partners = 0;
        for (int i = 0; i < n; i++) {
            double lx = c * xy[2 * i] - s * xy[2 * i + 1], ly = s * xy[2 * i] + c * xy[2 * i + 1];
            double px = pose[0] + lx, py = pose[1] + ly;
            double nx = c * normal[2 * i] - s * normal[2 * i + 1], ny = s * normal[2 * i] + c * normal[2 * i + 1];
            int oriented = nx != 0.0 || ny != 0.0;
            int col = (int)floor((px - x0) / cell), row = (int)floor((py - y0) / cell);
            if (col < reach || row < reach || col >= width - reach || row >= height - reach)
                continue;
            double nearest = gate * gate;
            const double *line = 0;
            for (int r = row - reach; r <= row + reach; r++) {
                const int32_t *at = slot + 2 * ((int64_t)r * width + col - reach);
                for (int k = 0; k < 2 * (2 * reach + 1); k++) {
                    if (at[k] < 0)
                        continue;
                    const double *f = surfel + SURFEL * at[k];
                    if (f[2] == 0.0 && f[3] == 0.0)
                        continue;
                    if (oriented && f[2] * nx + f[3] * ny < 0.7)
                        continue;
                    double dx = px - f[0], dy = py - f[1], d = dx * dx + dy * dy;
                    if (d < nearest) {
                        nearest = d;
                        line = f;
                    }
                }
            }
            if (!line)
                continue;
            partners++;
            double r = line[2] * (px - line[0]) + line[3] * (py - line[1]);
            double sigma = sigma_of[i], scaled = r / (2.0 * sigma);
            double w = 1.0 / ((1.0 + scaled * scaled) * sigma * sigma);
            double j2 = line[3] * lx - line[2] * ly;
            h[0] += w * line[2] * line[2];
            h[1] += w * line[2] * line[3];
            h[2] += w * line[2] * j2;
            h[4] += w * line[3] * line[3];
            h[5] += w * line[3] * j2;
            h[8] += w * j2 * j2;
            b[0] += w * line[2] * r;
            b[1] += w * line[3] * r;
            b[2] += w * j2 * r;
            total += w * r * r;
            absolute += fabs(r);
            inliers += fabs(r) < 3.0 * sigma;
        }
        h[3] = h[1];
        h[6] = h[2];
        h[7] = h[5];
        memcpy(info, h, sizeof h);
        stats[0] = inliers;
        stats[1] = total;
        stats[2] = partners ? absolute / partners : 0.0;
        double e[3] = {pose[0] - prior[0], pose[1] - prior[1], remainder(pose[2] - prior[2], 2.0 * M_PI)}, step[3];
        for (int k = 0; k < 3; k++) {
            for (int m = 0; m < 3; m++) {
                h[3 * k + m] += prior_info[3 * k + m];
                b[k] += prior_info[3 * k + m] * e[m];
            }
            h[4 * k] += 1e-9;
        }
        if (!solve3(h, b, step))
            break;
        pose[0] -= step[0];
        pose[1] -= step[1];
        pose[2] = remainder(pose[2] - step[2], 2.0 * M_PI);
        if (gate <= gate_end * 1.001 && fabs(step[0]) + fabs(step[1]) < 2e-5 && fabs(step[2]) < 1e-5)
            break;
        gate *= shrink;
        if (gate < gate_end)
            gate = gate_end;
    }
    return partners;
}

/* ---- occupancy: counters of beams that ended in a cell and that crossed it -------------------------------------------- */

/* Adds (`sign` 1) or takes back (-1) one scan: `seen` counts every beam that crossed or ended in a cell, `hit` those that
 * ended. Counters commute, so that a scan can be moved exactly when the graph moves it: cells are counted from the frame's
 * origin (`col0, row0` is the raster's first), so that a raster which has grown since rounds as it did before. Cells outside
 * are skipped. */
void count_beams(int32_t *seen, int32_t *hit, int width, int height, int col0, int row0, double cell, const double *xy,
                 int n, const double *pose, double sx, double sy, int sign)
{
    double c = cos(pose[2]), s = sin(pose[2]);
    double fx = (pose[0] + c * sx - s * sy) / cell, fy = (pose[1] + s * sx + c * sy) / cell;
    for (int i = 0; i < n; i++) {
        double ex = (pose[0] + c * xy[2 * i] - s * xy[2 * i + 1]) / cell;
        double ey = (pose[1] + s * xy[2 * i] + c * xy[2 * i + 1]) / cell;
        int col = (int)floor(fx), row = (int)floor(fy), last_col = (int)floor(ex), last_row = (int)floor(ey);
        double dx = ex - fx, dy = ey - fy;
        int step_col = dx > 0 ? 1 : -1, step_row = dy > 0 ? 1 : -1;
        double per_col = dx != 0.0 ? fabs(1.0 / dx) : INFINITY, per_row = dy != 0.0 ? fabs(1.0 / dy) : INFINITY;
        double next_col = dx > 0 ? (col + 1 - fx) * per_col : dx < 0 ? (fx - col) * per_col : INFINITY;
        double next_row = dy > 0 ? (row + 1 - fy) * per_row : dy < 0 ? (fy - row) * per_row : INFINITY;
        int left = abs(last_col - col) + abs(last_row - row);
        col -= col0;
        row -= row0;
        last_col -= col0;
        last_row -= row0;
        for (; left > 0; left--) { /* Amanatides and Woo, 1987 */
            if (col >= 0 && row >= 0 && col < width && row < height)
                seen[(int64_t)row * width + col] += sign;
            if (next_col < next_row) {
                next_col += per_col;
                col += step_col;
            } else {
                next_row += per_row;
                row += step_row;
            }
        }
        if (last_col >= 0 && last_row >= 0 && last_col < width && last_row < height) {
            seen[(int64_t)last_row * width + last_col] += sign;
            hit[(int64_t)last_row * width + last_col] += sign;
        }
    }
}

/* Counters to cells: -1 below `least` beams, 100 where the share of hits reaches `share`, else 0. */
void grade_cells(const int32_t *seen, const int32_t *hit, int64_t cells, int least, double share, int8_t *grid)
{
    for (int64_t i = 0; i < cells; i++)
        grid[i] = seen[i] < least ? -1 : hit[i] >= share * seen[i] ? 100 : 0;
}

/* How points at a pose agree with counters: those in seen-through free space (conflicts), and those in seen cells. */
void count_conflicts(const int32_t *seen, const int32_t *hit, int width, int height, double x0, double y0, double cell,
                     const double *xy, int n, const double *pose, int reach, int32_t *conflicts, int32_t *known)
{
    double c = cos(pose[2]), s = sin(pose[2]);
    *conflicts = *known = 0;
    for (int i = 0; i < n; i++) {
        int col = (int)floor((pose[0] + c * xy[2 * i] - s * xy[2 * i + 1] - x0) / cell);
        int row = (int)floor((pose[1] + s * xy[2 * i] + c * xy[2 * i + 1] - y0) / cell);
        if (col < reach || row < reach || col >= width - reach || row >= height - reach)
            continue;
        if (seen[(int64_t)row * width + col] < 2)
            continue;
        int near = 0;
        for (int r = row - reach; r <= row + reach && !near; r++)
            for (int k = col - reach; k <= col + reach && !near; k++)
                near = hit[(int64_t)r * width + k] > 0;
        ++*known;
        *conflicts += !near;
    }
}

/* ---- localization ---------------------------------------------------------------------------------------------------- */

/* Sum over the beams (`xy`, n) of `table[distance to the nearest obstacle in cells / 8]` for every particle; `distance` is
 * in eighths of a cell, clipped at 255, and what lies outside the raster counts as 255. */
void particle_scores(const double *particles, int count, const double *xy, int n, const uint8_t *distance, int width,
                     int height, double x0, double y0, double cell, const double *table, double *score)
{
    for (int p = 0; p < count; p++) {
        const double *at = particles + 3 * p;
        double c = cos(at[2]) / cell, s = sin(at[2]) / cell, ox = (at[0] - x0) / cell, oy = (at[1] - y0) / cell, sum = 0.0;
        for (int i = 0; i < n; i++) {
            int col = (int)floor(ox + c * xy[2 * i] - s * xy[2 * i + 1]);
            int row = (int)floor(oy + s * xy[2 * i] + c * xy[2 * i + 1]);
            int d = col >= 0 && row >= 0 && col < width && row < height ? distance[(int64_t)row * width + col] : 255;
            sum += table[d];
        }
        score[p] = sum;
    }
}

/* ---- pose graphs: sparse block Cholesky --------------------------------------------------------------------------------
 * Up-looking, after Davis, "Direct Methods for Sparse Linear Systems", 2006, chapter 4, on blocks of k x k (k is 2 or 3), so
 * that an index is looked up once for a pose. Vertices come in elimination order; `start, row` list for every column j the
 * rows i < j of the upper blocks A(i, j). */

/* The elimination tree (`parent`) and the number of blocks in every column of L (`count`, diagonal included).
 * `mark` is scratch of n. Returns the sum of counts. */
int64_t block_symbolic(int n, const int32_t *start, const int32_t *row, int32_t *parent, int32_t *count, int32_t *mark)
{
    int64_t total = 0;
    for (int k = 0; k < n; k++) {
        parent[k] = -1;
        mark[k] = k;
        count[k] = 1;
        for (int p = start[k]; p < start[k + 1]; p++)
            for (int i = row[p]; mark[i] != k; i = parent[i]) {
                if (parent[i] < 0)
                    parent[i] = k;
                mark[i] = k;
                count[i]++;
            }
    }
    for (int k = 0; k < n; k++)
        total += count[k];
    return total;
}

/* Adds the blocks of the edges: to[e] >= 0 is the slot of block e, flipped (transposed) where `flip[e]`; < 0 is left out. */
void add_blocks(const double *blocks, const int32_t *to, const uint8_t *flip, int count, int k, double *sum)
{
    for (int e = 0; e < count; e++) {
        if (to[e] < 0)
            continue;
        const double *b = blocks + (int64_t)e * k * k;
        double *s = sum + (int64_t)to[e] * k * k;
        for (int r = 0; r < k; r++)
            for (int c = 0; c < k; c++)
                s[r * k + c] += flip[e] ? b[c * k + r] : b[r * k + c];
    }
}

/* x <- x L^-T for a lower triangular block. */
static inline void right_solve(double *x, const double *l, int k)
{
    for (int r = 0; r < k; r++)
        for (int c = 0; c < k; c++) {
            double v = x[r * k + c];
            for (int m = 0; m < c; m++)
                v -= x[r * k + m] * l[c * k + m];
            x[r * k + c] = v / l[c * k + c];
        }
}

/* x <- x - a b^T */
static inline void subtract_outer(double *x, const double *a, const double *b, int k)
{
    for (int r = 0; r < k; r++)
        for (int c = 0; c < k; c++) {
            double v = 0.0;
            for (int m = 0; m < k; m++)
                v += a[r * k + m] * b[c * k + m];
            x[r * k + c] -= v;
        }
}

static inline int factor_block(double *d, int k)
{
    for (int c = 0; c < k; c++)
        for (int r = c; r < k; r++) {
            double v = d[r * k + c];
            for (int m = 0; m < c; m++)
                v -= d[r * k + m] * d[c * k + m];
            if (r == c) {
                if (!(v > 0.0))
                    return 0;
                d[r * k + c] = sqrt(v);
            } else {
                d[r * k + c] = v / d[c * k + c];
            }
        }
    return 1;
}

static inline int factor(int n, int k, const int32_t *start, const int32_t *row, const double *upper, const double *diagonal,
                         const int32_t *parent, const int64_t *column, int32_t *low_row, double *low, int64_t *filled,
                         int32_t *mark, int32_t *stack, double *x)
{
    int area = k * k;
    for (int j = 0; j < n; j++)
        mark[j] = -1;
    memset(x, 0, (size_t)n * area * sizeof(double));
    for (int j = 0; j < n; j++) {
        double d[9];
        memcpy(d, diagonal + (int64_t)j * area, area * sizeof(double));
        int top = n;
        mark[j] = j;
        for (int p = start[j]; p < start[j + 1]; p++) {
            int i = row[p], length = 0;
            /* row j of the lower triangle: A(j, i) = A(i, j)^T */
            double *to = x + (int64_t)i * area;
            const double *from = upper + (int64_t)p * area;
            for (int r = 0; r < k; r++)
                for (int c = 0; c < k; c++)
                    to[r * k + c] = from[c * k + r];
            for (; mark[i] != j; i = parent[i]) {
                stack[length++] = i;
                mark[i] = j;
            }
            while (length > 0)
                stack[--top] = stack[--length];
        }
        for (; top < n; top++) {
            int i = stack[top];
            double *block = x + (int64_t)i * area, value[9];
            const double *own = low + column[i] * area;
            memcpy(value, block, area * sizeof(double));
            memset(block, 0, area * sizeof(double));
            right_solve(value, own, k);
            for (int64_t p = column[i] + 1; p < filled[i]; p++)
                subtract_outer(x + (int64_t)low_row[p] * area, value, low + p * area, k);
            subtract_outer(d, value, value, k);
            low_row[filled[i]] = j;
            memcpy(low + filled[i] * area, value, area * sizeof(double));
            filled[i]++;
        }
        if (!factor_block(d, k))
            return 0;
        low_row[column[j]] = j;
        memcpy(low + column[j] * area, d, area * sizeof(double));
        filled[j] = column[j] + 1;
    }
    return 1;
}

/* L of A = L L^T into `low` (blocks by column, `column` their starts) and `low_row`. Scratch: `filled` (n), `mark` (n), `stack`
 * (n), `x` (n blocks). Returns 0 where A is not positive definite. */
int block_factor(int n, int k, const int32_t *start, const int32_t *row, const double *upper, const double *diagonal,
                 const int32_t *parent, const int64_t *column, int32_t *low_row, double *low, int64_t *filled, int32_t *mark,
                 int32_t *stack, double *x)
{
    /* constant k lets the compiler unroll the blocks */
    if (k == 3)
        return factor(n, 3, start, row, upper, diagonal, parent, column, low_row, low, filled, mark, stack, x);
    if (k == 2)
        return factor(n, 2, start, row, upper, diagonal, parent, column, low_row, low, filled, mark, stack, x);
    return 0;
}

/* b <- A^-1 b from L. */
void block_solve(int n, int k, const int64_t *column, const int32_t *low_row, const double *low, double *b)
{
    for (int j = 0; j < n; j++) {
        const double *d = low + column[j] * k * k;
        double *x = b + (int64_t)j * k;
        for (int r = 0; r < k; r++) {
            for (int m = 0; m < r; m++)
                x[r] -= d[r * k + m] * x[m];
            x[r] /= d[r * k + r];
        }
        for (int64_t p = column[j] + 1; p < column[j + 1]; p++) {
            double *y = b + (int64_t)low_row[p] * k;
            const double *l = low + p * k * k;
            for (int r = 0; r < k; r++)
                for (int m = 0; m < k; m++)
                    y[r] -= l[r * k + m] * x[m];
        }
    }
    for (int j = n - 1; j >= 0; j--) {
        double *x = b + (int64_t)j * k;
        for (int64_t p = column[j] + 1; p < column[j + 1]; p++) {
            const double *y = b + (int64_t)low_row[p] * k, *l = low + p * k * k;
            for (int r = 0; r < k; r++)
                for (int m = 0; m < k; m++)
                    x[r] -= l[m * k + r] * y[m];
        }
        const double *d = low + column[j] * k * k;
        for (int r = k - 1; r >= 0; r--) {
            for (int m = r + 1; m < k; m++)
                x[r] -= d[m * k + r] * x[m];
            x[r] /= d[r * k + r];
        }
    }
}
