/* The inner loops of model predictive path integral control for an omnidirectional base (Williams et al. 2017, "Information
 * theoretic MPC"; the critics are those of Nav2's MPPI controller).
 *
 * Trajectories are simulated side by side, LANES at a time, so that every loop over a time step is a loop over lanes with
 * contiguous float32 arrays. Coordinates: meters from the robot along the axes of the odometry frame. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define SIMD __attribute__((target_clones("avx2", "default")))
#else
#define SIMD
#endif

enum { LANES = 80, MAX_PATH = 256 };

/* The parameters that are constant over all cycles, in the order of mppi/kernels.py. */
typedef struct {
    int32_t tiles, batch, steps, align_step;
    float dt, std[3], acceleration[3], deceleration_x;
    float gamma, temperature;
    float max_speed, min_speed;
    float constraint_weight, collision_cost, critical_weight, repulsion_weight, collision_margin, inflation_radius;
    float goal_weight, goal_angle_weight, align_weight, follow_weight, angle_weight, forward_weight;
    int32_t align_offset, follow_offset, angle_offset;
    float align_occupancy, angle_max;
} Settings;

/* The inputs that change with every cycle. */
typedef struct {
    float velocity[3];
    float yaw;
    float goal_x, goal_y, goal_yaw;
    float grid_x, grid_y, cells_per_meter; /* corner of the padded distance grid */
    int32_t grid_height, grid_width;
    float collision_distance, margin_reach;
    float path_points_per_meter;
    int32_t path_size;
    int32_t use_repulsion, use_goal, use_goal_angle, use_align, use_follow, use_angle, use_forward;
} Scene;

/* Statistics of one cycle. */
typedef struct {
    float best_cost;
    int32_t best, furthest, free_trajectories, mean_contact_step, best_contact_step;
} Outcome;

typedef struct {
    float x[LANES], y[LANES], yaw[LANES], c[LANES], s[LANES];
    float v[3][LANES];
    float control_cost[LANES], excess[LANES], backward[LANES];
    float margin[LANES], repulsion[LANES], nearest[LANES];
    float goal_distance[LANES], goal_turn[LANES];
} Tile;

static inline float minimum(float a, float b) { return a < b ? a : b; }
static inline float maximum(float a, float b) { return a > b ? a : b; }

/* Returns the same angle within [-pi, pi]; vectorizes, unlike fmodf. */
static inline float wrapped(float angle) {
    return angle - 6.28318530718f * floorf(angle * 0.159154943092f + 0.5f);
}

/* Advances the omnidirectional model by one step. dt * wz <= 0.2 rad keeps the series' error under 1e-8, and unlike sinf the
 * series vectorizes. */
static inline void advance(float *x, float *y, float *yaw, float *c, float *s, float vx, float vy, float wz, float dt) {
    *x += (vx * *c - vy * *s) * dt;
    *y += (vx * *s + vy * *c) * dt;
    const float turn = wz * dt, square = turn * turn;
    const float sine = turn * (1.0f - square * (1.0f / 6.0f) * (1.0f - square * 0.05f));
    const float cosine = 1.0f - square * 0.5f * (1.0f - square * (1.0f / 12.0f));
    const float turned = *c * cosine - *s * sine;
    *s = *s * cosine + *c * sine;
    *c = turned;
    *yaw += turn;
}

/* Returns the meters to the nearest obstacle. The grid has a rim of one cell that is far from obstacles, which stands for
 * everything outside. */
static inline float distance_at(const Scene *scene, const float *grid, float x, float y) {
    float column = (x - scene->grid_x) * scene->cells_per_meter, row = (y - scene->grid_y) * scene->cells_per_meter;
    column = minimum(maximum(column, 0.0f), (float)(scene->grid_width - 1));
    row = minimum(maximum(row, 0.0f), (float)(scene->grid_height - 1));
    return grid[(int32_t)row * scene->grid_width + (int32_t)column];
}

SIMD static void simulate(const Settings *settings, const Scene *scene, const float *controls, const float *noise,
                          const float *grid, Tile *restrict tile, float *restrict track_x, float *restrict track_y) {
    const float dt = settings->dt, margin = settings->collision_margin, radius = scene->collision_distance, reach = scene->margin_reach;
    const float inflation = settings->inflation_radius;
    const int32_t steps = settings->steps;
    memset(tile, 0, sizeof *tile);
    const float c0 = cosf(scene->yaw), s0 = sinf(scene->yaw);
    for (int j = 0; j < LANES; j++) {
        tile->yaw[j] = scene->yaw;
        tile->c[j] = c0;
        tile->s[j] = s0;
        tile->nearest[j] = 1e9f;
        for (int k = 0; k < 3; k++) tile->v[k][j] = scene->velocity[k];
    }
    float pull[3];
    for (int32_t t = 0; t < steps; t++) {
        if (t > 0) {
            const float *row = noise + (int64_t)(t - 1) * 3 * LANES;
            for (int k = 0; k < 3; k++) {
                const float control = controls[k * steps + t - 1], deviation = settings->std[k];
                const float up = settings->acceleration[k] * dt;
                const float down = (k == 0 ? settings->deceleration_x : settings->acceleration[k]) * dt;
                pull[k] = settings->gamma / deviation * control; /* gamma / std^2 * u * (std * n) */
                float *restrict v = tile->v[k];
                const float *restrict n = row + k * LANES;
                for (int j = 0; j < LANES; j++) {
                    v[j] = minimum(maximum(control + deviation * n[j], v[j] - down), v[j] + up);
                    tile->control_cost[j] += pull[k] * n[j];
                }
            }
        }
        for (int j = 0; j < LANES; j++)
            advance(&tile->x[j], &tile->y[j], &tile->yaw[j], &tile->c[j], &tile->s[j], tile->v[0][j], tile->v[1][j],
                    tile->v[2][j], dt);
        for (int j = 0; j < LANES; j++) {
            const float vx = tile->v[0][j], vy = tile->v[1][j];
            const float speed = copysignf(sqrtf(vx * vx + vy * vy), vx);
            tile->excess[j] += maximum(speed - settings->max_speed, 0.0f) + maximum(settings->min_speed - speed, 0.0f);
            tile->backward[j] += maximum(-vx, 0.0f);
        }
        for (int j = 0; j < LANES; j++) {
            const float distance = distance_at(scene, grid, tile->x[j], tile->y[j]), clearance = distance - radius;
            tile->nearest[j] = minimum(tile->nearest[j], clearance);
            tile->margin[j] += clearance < reach ? maximum(margin - clearance, 0.0f) : 0.0f;
            tile->repulsion[j] += maximum(inflation - clearance, 0.0f);
        }
        if (scene->use_goal)
            for (int j = 0; j < LANES; j++) {
                const float dx = tile->x[j] - scene->goal_x, dy = tile->y[j] - scene->goal_y;
                tile->goal_distance[j] += sqrtf(dx * dx + dy * dy);
            }
        if (scene->use_goal_angle)
            for (int j = 0; j < LANES; j++) tile->goal_turn[j] += fabsf(wrapped(tile->yaw[j] - scene->goal_yaw));
        if (t % settings->align_step == 0) {
            memcpy(track_x, tile->x, sizeof tile->x);
            memcpy(track_y, tile->y, sizeof tile->y);
            track_x += LANES;
            track_y += LANES;
        }
    }
}

/* Finds the index of the path point nearest to each lane's end. */
SIMD static void reached_points(const Scene *scene, const float *path_x, const float *path_y, const float *x, const float *y,
                                float *restrict reached) {
    float best[LANES];
    for (int j = 0; j < LANES; j++) best[j] = 1e9f;
    for (int32_t p = 0; p < scene->path_size; p++)
        for (int j = 0; j < LANES; j++) {
            const float dx = x[j] - path_x[p], dy = y[j] - path_y[p], square = dx * dx + dy * dy;
            reached[j] = square < best[j] ? (float)p : reached[j];
            best[j] = minimum(best[j], square);
        }
}

/* Adds the cost of a trajectory's mean distance to the path at equal arc lengths. */
SIMD static void align(const Settings *settings, const Scene *scene, const float *path_x, const float *path_y,
                       const float *path_free, int32_t segments, const float *track_x, const float *track_y,
                       float *restrict cost) {
    float along[LANES] = {0}, sum[LANES] = {0}, samples[LANES] = {0};
    const int32_t points = (settings->steps + settings->align_step - 1) / settings->align_step;
    const float last = (float)(segments - 1);
    for (int32_t p = 1; p < points; p++) {
        const float *x = track_x + p * LANES, *y = track_y + p * LANES;
        for (int j = 0; j < LANES; j++) {
            const float dx = x[j] - x[j - LANES], dy = y[j] - y[j - LANES];
            along[j] += sqrtf(dx * dx + dy * dy);
            const int32_t at = (int32_t)minimum(along[j] * scene->path_points_per_meter + 0.5f, last);
            const float ex = path_x[at] - x[j], ey = path_y[at] - y[j], use = path_free[at];
            sum[j] += use * sqrtf(ex * ex + ey * ey);
            samples[j] += use;
        }
    }
    for (int j = 0; j < LANES; j++) cost[j] += settings->align_weight * sum[j] / maximum(samples[j], 1.0f);
}

/* Returns atan2 to 1e-4 rad (Hastings' polynomial): enough for a cost, and it vectorizes. */
static inline float heading(float y, float x) {
    const float ax = fabsf(x), ay = fabsf(y), high = maximum(ax, ay) + 1e-12f, low = minimum(ax, ay);
    const float r = low / high, square = r * r;
    float angle = r * (0.9998660f + square * (-0.3302995f + square * (0.1801410f + square * (-0.0851330f + square * 0.0208351f))));
    angle = ay > ax ? 1.57079632679f - angle : angle;
    angle = x < 0.0f ? 3.14159265359f - angle : angle;
    return y < 0.0f ? -angle : angle;
}

SIMD static void follow(const Settings *settings, const Scene *scene, float follow_x, float follow_y, float angle_x,
                        float angle_y, const Tile *tile, float *restrict cost) {
    if (scene->use_follow)
        for (int j = 0; j < LANES; j++) {
            const float dx = follow_x - tile->x[j], dy = follow_y - tile->y[j];
            cost[j] += settings->follow_weight * sqrtf(dx * dx + dy * dy);
        }
    if (scene->use_angle)
        for (int j = 0; j < LANES; j++) {
            const float wanted = heading(angle_y - tile->y[j], angle_x - tile->x[j]);
            cost[j] += settings->angle_weight * fabsf(wrapped(wanted - tile->yaw[j]));
        }
}

/* Returns the sum of weight_j * noise_j over one tile, in eight partial sums that the compiler keeps in one register. */
SIMD static float weighted_sum(const float *weights, const float *noise) {
    float partial[8] = {0};
    for (int j = 0; j < LANES; j += 8)
        for (int i = 0; i < 8; i++) partial[i] += weights[j + i] * noise[j + i];
    return ((partial[0] + partial[4]) + (partial[1] + partial[5])) + ((partial[2] + partial[6]) + (partial[3] + partial[7]));
}

/* Returns the first step at which a control sequence comes too near to an obstacle, or `steps`. With a negative lane the
 * sequence is used as it is; else the noise of that lane is added. */
static int32_t contact_step(const Settings *settings, const Scene *scene, const float *controls, const float *noise,
                            int32_t lane, const float *grid) {
    float x = 0.0f, y = 0.0f, yaw = scene->yaw, c = cosf(yaw), s = sinf(yaw), v[3];
    for (int k = 0; k < 3; k++) v[k] = scene->velocity[k];
    for (int32_t t = 0; t < settings->steps; t++) {
        for (int k = 0; t > 0 && k < 3; k++) {
            const float up = settings->acceleration[k] * settings->dt;
            const float down = (k == 0 ? settings->deceleration_x : settings->acceleration[k]) * settings->dt;
            float wanted = controls[k * settings->steps + t - 1];
            if (lane >= 0) {
                const int64_t tile = lane / LANES;
                wanted += settings->std[k] * noise[((tile * settings->steps + t - 1) * 3 + k) * LANES + lane % LANES];
            }
            v[k] = minimum(maximum(wanted, v[k] - down), v[k] + up);
        }
        advance(&x, &y, &yaw, &c, &s, v[0], v[1], v[2], settings->dt);
        if (distance_at(scene, grid, x, y) <= scene->collision_distance) return t;
    }
    return settings->steps;
}

int64_t lanes(void) { return LANES; }

/* Runs one iteration: sample, simulate, evaluate, average.
 *
 * controls (3, steps): the sequence, replaced by the weighted mean. noise (tiles, steps, 3, LANES): unit normal. grid: padded
 * distances. path: x, y and 1 if free, path_size points evenly spaced. costs, reached, tracks, tile_memory: scratch memory.
 * best_controls (3, steps): the cheapest sample. Returns 0, or 1 if every trajectory collides (controls untouched). */
int64_t optimize(const Settings *settings, const Scene *scene, float *controls, const float *noise, const float *grid,
                 const float *path_x, const float *path_y, const float *path_free, float *costs, float *reached,
                 float *tracks, void *tile_memory, float *best_controls, Outcome *outcome) {
    const int32_t tiles = settings->tiles, steps = settings->steps;
    const int32_t points = (steps + settings->align_step - 1) / settings->align_step;
    Tile *tile = tile_memory;
    int32_t furthest = 0, free_trajectories = 0;
    float least_repulsion = 1e30f;
    for (int32_t i = 0; i < tiles; i++) {
        float *track_x = tracks + (int64_t)i * 2 * points * LANES, *track_y = track_x + (int64_t)points * LANES;
        simulate(settings, scene, controls, noise + (int64_t)i * steps * 3 * LANES, grid, &tile[i], track_x, track_y);
        for (int j = 0; j < LANES; j++) reached[i * LANES + j] = 0.0f;
        if (scene->path_size > 0) reached_points(scene, path_x, path_y, tile[i].x, tile[i].y, reached + i * LANES);
        for (int j = 0; j < LANES && i * LANES + j < settings->batch; j++) {
            if (tile[i].nearest[j] <= 0.0f) continue;
            free_trajectories++;
            least_repulsion = minimum(least_repulsion, tile[i].repulsion[j]);
            /* Only points that a trajectory reaches without a collision count as within reach. */
            furthest = (int32_t)reached[i * LANES + j] > furthest ? (int32_t)reached[i * LANES + j] : furthest;
        }
    }
    outcome->furthest = furthest;
    outcome->free_trajectories = free_trajectories;
    if (free_trajectories == 0) return 1;

    int32_t segments = furthest + 1, occupied = 0;
    for (int32_t p = 0; p < segments && p < scene->path_size; p++) occupied += path_free[p] == 0.0f;
    const int use_align = scene->use_align && furthest >= settings->align_offset &&
                          !(occupied > 2 && (float)occupied > settings->align_occupancy * (float)segments);
    const int32_t last = scene->path_size - 1;
    int32_t to_follow = furthest + settings->follow_offset < last ? furthest + settings->follow_offset : last;
    while (to_follow >= 0 && to_follow < last && path_free[to_follow] == 0.0f) to_follow++;
    const int32_t to_face = furthest + settings->angle_offset < last ? furthest + settings->angle_offset : last;
    Scene judged = *scene;
    float follow_x = 0, follow_y = 0, angle_x = 0, angle_y = 0;
    if (last > 0) {
        follow_x = path_x[to_follow];
        follow_y = path_y[to_follow];
        angle_x = path_x[to_face];
        angle_y = path_y[to_face];
        if (fabsf(wrapped(atan2f(angle_y, angle_x) - scene->yaw)) < settings->angle_max) judged.use_angle = 0;
    } else {
        judged.use_follow = judged.use_angle = 0;
    }

    const float over_steps = 1.0f / (float)steps;
    float best = 1e30f;
    for (int32_t i = 0; i < tiles; i++) {
        const Tile *lane = &tile[i];
        float *cost = costs + i * LANES;
        for (int j = 0; j < LANES; j++) {
            const float raw = lane->nearest[j] <= 0.0f ? settings->collision_cost : lane->margin[j];
            const float repulsion = maximum(lane->repulsion[j] - least_repulsion, 0.0f) * over_steps;
            cost[j] = lane->control_cost[j] + settings->constraint_weight * settings->dt * lane->excess[j] +
                      settings->critical_weight * raw +
                      (scene->use_repulsion ? settings->repulsion_weight * repulsion : 0.0f) +
                      settings->goal_weight * over_steps * lane->goal_distance[j] +
                      settings->goal_angle_weight * over_steps * lane->goal_turn[j] +
                      (scene->use_forward ? settings->forward_weight * settings->dt * lane->backward[j] : 0.0f);
        }
        if (use_align) {
            const float *track_x = tracks + (int64_t)i * 2 * points * LANES;
            align(settings, scene, path_x, path_y, path_free, segments, track_x, track_x + (int64_t)points * LANES, cost);
        }
        follow(settings, &judged, follow_x, follow_y, angle_x, angle_y, lane, cost);
        for (int j = 0; j < LANES && i * LANES + j < settings->batch; j++)
            if (cost[j] < best) {
                best = cost[j];
                outcome->best = i * LANES + j;
            }
    }
    outcome->best_cost = best;

    float total = 0.0f;
    for (int32_t b = 0; b < tiles * LANES; b++) {
        costs[b] = b < settings->batch ? expf((best - costs[b]) / settings->temperature) : 0.0f;
        total += costs[b];
    }
    const int32_t best_tile = outcome->best / LANES, best_lane = outcome->best % LANES;
    for (int32_t t = 0; t < steps; t++)
        for (int k = 0; k < 3; k++) {
            const float *row = noise + ((int64_t)best_tile * steps + t) * 3 * LANES + k * LANES;
            best_controls[k * steps + t] = controls[k * steps + t] + settings->std[k] * row[best_lane];
        }
    outcome->best_contact_step = contact_step(settings, scene, controls, noise, outcome->best, grid);
    for (int32_t t = 0; t < steps; t++)
        for (int k = 0; k < 3; k++) {
            float sum = 0.0f;
            for (int32_t i = 0; i < tiles; i++)
                sum += weighted_sum(costs + i * LANES, noise + (((int64_t)i * steps + t) * 3 + k) * LANES);
            controls[k * steps + t] += settings->std[k] * sum / total;
        }
    outcome->mean_contact_step = contact_step(settings, scene, controls, noise, -1, grid);
    return 0;
}

/* Returns the first step at which a control sequence, which the caller may have changed, comes too near to an obstacle. */
int64_t first_contact(const Settings *settings, const Scene *scene, const float *controls, const float *grid) {
    return contact_step(settings, scene, controls, NULL, -1, grid);
}

int64_t tile_bytes(void) { return (int64_t)sizeof(Tile); }

/* Fills `out` with unit normals: xoshiro128+ (Blackman & Vigna 2018) and Box-Muller in pairs. The same seed gives the same
 * numbers on every machine up to the last bit of its libm. */
void fill_normal(uint64_t seed, float *out, int64_t count) {
    uint32_t s[4];
    for (int i = 0; i < 4; i++) { /* splitmix64 spreads the seed */
        seed += 0x9E3779B97F4A7C15ULL;
        uint64_t z = seed;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
        s[i] = (uint32_t)((z ^ (z >> 31)) >> 32);
    }
    for (int64_t i = 0; i < count; i += 2) {
        float u[2];
        for (int k = 0; k < 2; k++) {
            const uint32_t drawn = s[0] + s[3], shifted = s[1] << 9;
            s[2] ^= s[0];
            s[3] ^= s[1];
            s[1] ^= s[2];
            s[0] ^= s[3];
            s[2] ^= shifted;
            s[3] = (s[3] << 11) | (s[3] >> 21);
            u[k] = ((float)(drawn >> 8) + 0.5f) * (1.0f / 16777216.0f);
        }
        const float radius = sqrtf(-2.0f * logf(u[0])), angle = 6.28318530718f * u[1];
        out[i] = radius * cosf(angle);
        if (i + 1 < count) out[i + 1] = radius * sinf(angle);
    }
}
