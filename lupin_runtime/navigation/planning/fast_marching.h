/* The fast marching method (Sethian 1996) on a bucket queue (Yatziv, Bartesaghi & Sapiro 2006), and the descent of its
 * arrival times. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { FAR = 0, TRIAL = 1, KNOWN = 2 };

typedef struct {
    int32_t *head, *next, *previous;
    int64_t buckets, lowest, count;
    float per_unit;
} Queue;

static void take_out(Queue *queue, int32_t cell, float time) {
    const int32_t before = queue->previous[cell], after = queue->next[cell];
    if (before >= 0)
        queue->next[before] = after;
    else
        queue->head[(int64_t)(time * queue->per_unit) % queue->buckets] = after;
    if (after >= 0) queue->previous[after] = before;
    queue->count--;
}

static void put_in(Queue *queue, int32_t cell, float time) {
    int32_t *head = &queue->head[(int64_t)(time * queue->per_unit) % queue->buckets];
    queue->previous[cell] = -1;
    queue->next[cell] = *head;
    if (*head >= 0) queue->previous[*head] = cell;
    *head = cell;
    queue->count++;
}

/* Returns the upwind solution of |grad T| = slowness at a cell, spacing 1. */
static float arrival(const float *time, const uint8_t *state, int64_t row, int64_t column, int64_t height, int64_t width,
                     float slowness) {
    const int64_t at = row * width + column;
    float a = INFINITY, b = INFINITY;
    if (column > 0 && state[at - 1] == KNOWN) a = time[at - 1];
    if (column + 1 < width && state[at + 1] == KNOWN && time[at + 1] < a) a = time[at + 1];
    if (row > 0 && state[at - width] == KNOWN) b = time[at - width];
    if (row + 1 < height && state[at + width] == KNOWN && time[at + width] < b) b = time[at + width];
    const float apart = fabsf(a - b);
    if (!(apart < slowness)) return (a < b ? a : b) + slowness;
    return 0.5f * (a + b + sqrtf(2.0f * slowness * slowness - apart * apart));
}

/* Computes arrival times, in cells times slowness, of a front from `start` over `slowness` (height, width; <= 0: blocked, else
 * at least 1 and at most `slowest`). Stops once `goal` (or no cell: -1) is reached. Unreached cells read infinity. Returns 1 if
 * the goal was reached, 0 if not, -1 if memory runs out. */
int64_t march(const float *slowness, int64_t height, int64_t width, int64_t start, int64_t goal, double slowest, float *time) {
    const int64_t cells = height * width;
    Queue queue = {0};
    /* A quarter of a cell per bucket keeps the error of unsorted buckets under that of the scheme itself. */
    queue.per_unit = 4.0f;
    queue.buckets = (int64_t)(slowest * queue.per_unit) + 8;
    queue.head = malloc((size_t)queue.buckets * sizeof(int32_t));
    queue.next = malloc((size_t)cells * sizeof(int32_t));
    queue.previous = malloc((size_t)cells * sizeof(int32_t));
    uint8_t *state = calloc((size_t)cells, 1);
    int64_t reached = -1;
    if (queue.head && queue.next && queue.previous && state) {
        reached = 0;
        for (int64_t i = 0; i < queue.buckets; i++) queue.head[i] = -1;
        for (int64_t i = 0; i < cells; i++) time[i] = INFINITY;
        time[start] = 0.0f;
        state[start] = TRIAL;
        put_in(&queue, (int32_t)start, 0.0f);
        while (queue.count > 0 && !reached) {
            int32_t *head = &queue.head[queue.lowest % queue.buckets];
            if (*head < 0) {
                queue.lowest++;
                continue;
            }
            const int32_t cell = *head;
            take_out(&queue, cell, time[cell]);
            state[cell] = KNOWN;
            if (cell == goal) reached = 1;
            const int64_t row = cell / width, column = cell % width;
            const int64_t rows[4] = {row, row, row - 1, row + 1}, columns[4] = {column - 1, column + 1, column, column};
            for (int i = 0; i < 4; i++) {
                if (rows[i] < 0 || columns[i] < 0 || rows[i] >= height || columns[i] >= width) continue;
                const int64_t other = rows[i] * width + columns[i];
                if (state[other] == KNOWN || !(slowness[other] > 0.0f)) continue;
                const float found = arrival(time, state, rows[i], columns[i], height, width, slowness[other]);
                if (found >= time[other]) continue;
                if (state[other] == TRIAL) take_out(&queue, (int32_t)other, time[other]);
                /* An unsorted bucket may yield a time just below the one being emptied. */
                const float floor_time = (float)queue.lowest / queue.per_unit;
                time[other] = found > floor_time ? found : floor_time;
                state[other] = TRIAL;
                put_in(&queue, (int32_t)other, time[other]);
            }
        }
        for (int64_t i = 0; i < cells; i++)
            if (state[i] != KNOWN) time[i] = INFINITY;
    }
    free(queue.head);
    free(queue.next);
    free(queue.previous);
    free(state);
    return reached;
}

/* Interpolates the time and its gradient between four centers; returns 0 if one of them was not reached. */
static int interpolate(const float *time, int64_t height, int64_t width, double x, double y, double *value, double *gx,
                       double *gy) {
    const double fx = floor(x - 0.5), fy = floor(y - 0.5);
    const int64_t column = (int64_t)fx, row = (int64_t)fy;
    if (row < 0 || column < 0 || row + 1 >= height || column + 1 >= width) return 0;
    const float *low = time + row * width + column, *high = low + width;
    const double a = low[0], b = low[1], c = high[0], d = high[1];
    if (!(a < INFINITY && b < INFINITY && c < INFINITY && d < INFINITY)) return 0;
    const double u = x - 0.5 - fx, v = y - 0.5 - fy;
    *value = (a * (1 - u) + b * u) * (1 - v) + (c * (1 - u) + d * u) * v;
    *gx = (b - a) * (1 - v) + (d - c) * v;
    *gy = (c - a) * (1 - u) + (d - b) * u;
    return 1;
}

/* Follows the arrival times down from `from` (x, y in cells, centers at .5) to the cell `to`, along their gradient or, if that
 * fails or without `smooth`, from center to center. Writes up to `capacity` points (x, y); returns their number, or -1 if the
 * descent does not end. */
int64_t descend(const float *time, int64_t height, int64_t width, const double *from, int64_t to, int64_t smooth,
                double *path, int64_t capacity) {
    const double stride = 0.5, to_x = (double)(to % width) + 0.5, to_y = (double)(to / width) + 0.5;
    double x = from[0], y = from[1];
    int64_t count = 0;
    while (count < capacity) {
        path[2 * count] = x;
        path[2 * count + 1] = y;
        count++;
        if (hypot(x - to_x, y - to_y) < 1.5) return count;
        double value, gx, gy, next_value, unused_x, unused_y;
        if (smooth && interpolate(time, height, width, x, y, &value, &gx, &gy)) {
            const double length = hypot(gx, gy);
            if (length > 1e-9) {
                const double next_x = x - stride * gx / length, next_y = y - stride * gy / length;
                if (interpolate(time, height, width, next_x, next_y, &next_value, &unused_x, &unused_y) &&
                    next_value < value - 1e-6) {
                    x = next_x;
                    y = next_y;
                    continue;
                }
            }
        }
        /* Along walls: from center to center, never between two diagonal cells of which one is blocked. */
        const int64_t row = (int64_t)floor(y), column = (int64_t)floor(x);
        if (row < 0 || column < 0 || row >= height || column >= width) return -1;
        float best = time[row * width + column];
        int64_t best_row = -1, best_column = -1;
        for (int64_t r = row - 1; r <= row + 1; r++)
            for (int64_t c = column - 1; c <= column + 1; c++) {
                if (r < 0 || c < 0 || r >= height || c >= width || (r == row && c == column)) continue;
                if (r != row && c != column &&
                    !(time[r * width + column] < INFINITY && time[row * width + c] < INFINITY))
                    continue;
                if (time[r * width + c] < best) {
                    best = time[r * width + c];
                    best_row = r;
                    best_column = c;
                }
            }
        if (best_row < 0) return -1;
        x = (double)best_column + 0.5;
        y = (double)best_row + 0.5;
    }
    return -1;
}
