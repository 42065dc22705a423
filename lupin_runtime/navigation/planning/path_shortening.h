/* Pulls a path tight: first exactly on the grid of blocked cells, then around the obstacles themselves. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Coordinates are integers in 1/UNIT of a cell, so that a turn is exactly left, right or straight. */
enum { UNIT = 128 };

typedef struct {
    int64_t x, y;
} Point;

typedef struct {
    Point at;
    int32_t before, after;
} Knot;

typedef struct {
    Knot *knots;
    int64_t count, capacity;
    Point *hull;
    int64_t hull_count, hull_capacity;
} String;

static int64_t cross(Point o, Point a, Point b) { return (a.x - o.x) * (b.y - o.y) - (a.y - o.y) * (b.x - o.x); }

static int64_t square(Point a, Point b) { return (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y); }

static int32_t string_add(String *string, Point at) {
    if (string->count == string->capacity) {
        const int64_t capacity = string->capacity ? 2 * string->capacity : 1024;
        Knot *knots = realloc(string->knots, (size_t)capacity * sizeof(Knot));
        if (!knots) return -1;
        string->knots = knots;
        string->capacity = capacity;
    }
    string->knots[string->count] = (Knot){at, -1, -1};
    return (int32_t)string->count++;
}

static int hull_add(String *string, Point at) {
    if (string->hull_count == string->hull_capacity) {
        const int64_t capacity = string->hull_capacity ? 2 * string->hull_capacity : 256;
        Point *hull = realloc(string->hull, (size_t)capacity * sizeof(Point));
        if (!hull) return 0;
        string->hull = hull;
        string->hull_capacity = capacity;
    }
    string->hull[string->hull_count++] = at;
    return 1;
}

static int is_set(const uint8_t *cells, int64_t height, int64_t width, int64_t x, int64_t y) {
    return x >= 0 && y >= 0 && x < width && y < height && cells[y * width + x];
}

/* Returns whether blocked cells form a corner, on which a string could catch, at a point of the lattice. */
static int catches(const uint8_t *blocked, int64_t height, int64_t width, int64_t x, int64_t y) {
    const int a = is_set(blocked, height, width, x - 1, y - 1), b = is_set(blocked, height, width, x, y - 1);
    const int c = is_set(blocked, height, width, x - 1, y), d = is_set(blocked, height, width, x, y);
    const int count = a + b + c + d;
    return count == 1 || (count == 2 && a == d);
}

/* Collects the corners in the closed triangle a, v, b. Returns 0 if memory runs out. */
static int corners_within(String *string, const uint8_t *blocked, int64_t height, int64_t width, Point a, Point v, Point b) {
    const Point triangle[3] = {a, v, b};
    int64_t low = a.y, high = a.y;
    for (int i = 1; i < 3; i++) {
        low = triangle[i].y < low ? triangle[i].y : low;
        high = triangle[i].y > high ? triangle[i].y : high;
    }
    const int64_t side = cross(a, v, b) > 0 ? 1 : -1;
    string->hull_count = 0;
    for (int64_t row = (low + UNIT - 1) / UNIT; row * UNIT <= high; row++) {
        const int64_t y = row * UNIT;
        double left = INFINITY, right = -INFINITY;
        for (int i = 0; i < 3; i++) {
            const Point p = triangle[i], q = triangle[(i + 1) % 3];
            if ((p.y < y && q.y < y) || (p.y > y && q.y > y)) continue;
            if (p.y == q.y) {
                left = fmin(left, (double)(p.x < q.x ? p.x : q.x));
                right = fmax(right, (double)(p.x > q.x ? p.x : q.x));
            } else {
                const double x = (double)p.x + (double)(q.x - p.x) * (double)(y - p.y) / (double)(q.y - p.y);
                left = fmin(left, x);
                right = fmax(right, x);
            }
        }
        if (!(left <= right)) continue;
        for (int64_t column = (int64_t)ceil((left - 1.0) / UNIT); column <= (int64_t)floor((right + 1.0) / UNIT); column++) {
            if (!catches(blocked, height, width, column, row)) continue;
            const Point p = {column * UNIT, y};
            if (side * cross(a, v, p) < 0 || side * cross(v, b, p) < 0 || side * cross(b, a, p) < 0) continue;
            if (!hull_add(string, p)) return 0;
        }
    }
    return 1;
}

/* Pulls the string between its knots tight around the corners of blocked cells. The string must not touch the inside of a
 * blocked cell. Each step replaces a knot by the hull of the corners in its triangle, which is the shortest path around them. A
 * string that no step shortens is the shortest of all that pass the obstacles on the same sides. Returns 0 if memory runs out.
 */
static int tighten(String *string, const uint8_t *blocked, int64_t height, int64_t width, int32_t first, int32_t last) {
    int64_t budget = 200000 + 64 * string->count;
    for (int32_t at = string->knots[first].after; at != last && budget-- > 0;) {
        const int32_t before = string->knots[at].before, after = string->knots[at].after;
        const Point a = string->knots[before].at, v = string->knots[at].at, b = string->knots[after].at;
        const int64_t turn = cross(a, v, b);
        string->hull_count = 0;
        if (turn != 0 && !corners_within(string, blocked, height, width, a, v, b)) return 0;
        /* Gift wrapping from a to b on the side of v. */
        const int64_t side = turn > 0 ? 1 : -1;
        Point here = a;
        int32_t tail = before;
        int changed = 1;
        for (int64_t wraps = 0; wraps <= string->hull_count; wraps++) {
            Point next = b;
            for (int64_t i = 0; i < string->hull_count; i++) {
                const Point p = string->hull[i];
                if ((p.x == here.x && p.y == here.y) || (p.x == b.x && p.y == b.y)) continue;
                const int64_t beyond = side * cross(here, next, p);
                if (beyond < 0 || (beyond == 0 && square(here, p) > square(here, next))) next = p;
            }
            if (next.x == b.x && next.y == b.y) break;
            if (next.x == v.x && next.y == v.y) {
                changed = 0;
                break;
            }
            const int32_t knot = string_add(string, next);
            if (knot < 0) return 0;
            string->knots[tail].after = knot;
            string->knots[knot].before = tail;
            tail = knot;
            here = next;
        }
        if (!changed) {
            /* The knot itself is a corner that holds the string; the knots added before it on the hull are dropped again. */
            string->knots[before].after = at;
            string->knots[at].before = before;
            at = after;
            continue;
        }
        string->knots[tail].after = after;
        string->knots[after].before = tail;
        at = before == first ? string->knots[first].after : before;
    }
    return 1;
}

/* -- around the obstacles themselves ----------------------------------------------------------------------------------- */
typedef struct {
    double x, y;
} Vec2;

/* Returns the nearest point of a segment to a point, as a fraction of the segment. */
static double nearest_fraction(Vec2 a, Vec2 b, Vec2 p) {
    const double dx = b.x - a.x, dy = b.y - a.y, length = dx * dx + dy * dy;
    if (length <= 0.0) return 0.0;
    const double t = ((p.x - a.x) * dx + (p.y - a.y) * dy) / length;
    return t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t;
}

/* Finds the obstacle point nearest to a segment, within `reach`. Occupied cells are squares. Returns the distance (infinity if
 * no obstacle is within reach), and the pair of nearest points. */
static double nearest_obstacle(const uint8_t *occupied, int64_t height, int64_t width, Vec2 a, Vec2 b, double reach,
                               Vec2 *on_segment, Vec2 *obstacle) {
    double best = INFINITY;
    const double low = fmin(a.y, b.y) - reach, high = fmax(a.y, b.y) + reach;
    for (int64_t row = (int64_t)fmax(floor(low), 0.0); row <= (int64_t)floor(high) && row < height; row++) {
        /* The part of the segment within reach of this row bounds the columns to look at. */
        double t0 = 0.0, t1 = 1.0;
        if (a.y != b.y) {
            const double u = ((double)row - reach - a.y) / (b.y - a.y), w = ((double)row + 1.0 + reach - a.y) / (b.y - a.y);
            t0 = fmax(0.0, fmin(u, w));
            t1 = fmin(1.0, fmax(u, w));
            if (t0 > t1) continue;
        }
        const double x0 = a.x + t0 * (b.x - a.x), x1 = a.x + t1 * (b.x - a.x);
        const int64_t from = (int64_t)fmax(floor(fmin(x0, x1) - reach), 0.0), to = (int64_t)floor(fmax(x0, x1) + reach);
        const uint8_t *cells = occupied + row * width;
        for (int64_t column = from; column <= to && column < width; column++) {
            if (!cells[column]) continue;
            /* The nearest pair of a segment and a square includes an end of the segment or a corner of the square. */
            for (int i = 0; i < 6; i++) {
                Vec2 on, of;
                if (i < 2) {
                    on = i ? b : a;
                    of.x = fmin(fmax(on.x, (double)column), (double)column + 1.0);
                    of.y = fmin(fmax(on.y, (double)row), (double)row + 1.0);
                } else {
                    of = (Vec2){(double)(column + (i & 1)), (double)(row + ((i - 2) >> 1))};
                    const double t = nearest_fraction(a, b, of);
                    on = (Vec2){a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)};
                }
                const double distance = hypot(on.x - of.x, on.y - of.y);
                if (distance < best && distance <= reach) {
                    best = distance;
                    *on_segment = on;
                    *obstacle = of;
                }
            }
        }
    }
    return best;
}

static int too_near(const uint8_t *occupied, int64_t height, int64_t width, Vec2 a, Vec2 b, double radius) {
    Vec2 on, of;
    return nearest_obstacle(occupied, height, width, a, b, radius, &on, &of) < radius;
}

static Vec2 towards(Vec2 from, Vec2 to, double distance) {
    const double length = hypot(to.x - from.x, to.y - from.y);
    const double share = length > distance ? distance / length : 1.0;
    return (Vec2){from.x + share * (to.x - from.x), from.y + share * (to.y - from.y)};
}

typedef struct {
    const uint8_t *occupied;
    int64_t height, width;
    double radius; /* the distance that the path keeps, in cells */
    Vec2 *path;
    int64_t count, capacity;
} Band;

static int band_near(const Band *band, Vec2 a, Vec2 b) {
    return too_near(band->occupied, band->height, band->width, a, b, band->radius);
}

static int band_insert(Band *band, int64_t at, Vec2 place) {
    if (band->count == band->capacity) return 0;
    memmove(band->path + at + 1, band->path + at, (size_t)(band->count - at) * sizeof(Vec2));
    band->path[at] = place;
    band->count++;
    return 1;
}

static void band_remove(Band *band, int64_t at) {
    memmove(band->path + at, band->path + at + 1, (size_t)(band->count - at - 1) * sizeof(Vec2));
    band->count--;
}

/* Pushes a path, which is accurate to within a cell, out to the radius. Returns 0 if two obstacles leave no room. */
static int band_push(Band *band) {
    /* Points are moved slightly beyond the radius, so that a chord between two of them violates it only if it spans more than
     * 0.2 rad. */
    const double outer = band->radius * 1.005 + 0.005;
    int64_t budget = 4000 + 8 * band->count;
    for (int64_t i = 0; i + 1 < band->count;) {
        if (budget-- <= 0) return 0;
        Vec2 *path = band->path, on = {0}, of = {0};
        const double distance =
            nearest_obstacle(band->occupied, band->height, band->width, path[i], path[i + 1], band->radius, &on, &of);
        if (!(distance < band->radius)) {
            i++;
            continue;
        }
        if (distance < 1e-6) return 0;
        const int at_first = hypot(on.x - path[i].x, on.y - path[i].y) < 0.25;
        const int at_second = hypot(on.x - path[i + 1].x, on.y - path[i + 1].y) < 0.25;
        const Vec2 moved = {of.x + (on.x - of.x) * outer / distance, of.y + (on.y - of.y) * outer / distance};
        if ((at_first && i == 0) || (at_second && i + 2 == band->count)) {
            i++; /* start and goal stay where they are */
        } else if (at_first) {
            path[i] = moved;
            i--;
        } else if (at_second) {
            path[i + 1] = moved;
        } else if (!band_insert(band, i + 1, moved)) {
            return 0;
        }
    }
    return 1;
}

/* Cuts the corners of a path as far as the radius allows: a corner becomes two with half the turn each, so that after a few
 * rounds the path follows the tangents and the arcs between them to within a tenth of a cell. */
static void band_cut(Band *band) {
    const double arm = 20.0;
    for (int round = 0; round < 4; round++) {
        for (int64_t i = 1; i + 1 < band->count;) {
            const Vec2 before = band->path[i - 1], corner = band->path[i], after = band->path[i + 1];
            if (!band_near(band, before, after)) {
                band_remove(band, i);
                i = i > 1 ? i - 1 : 1;
                continue;
            }
            const double turn = (corner.x - before.x) * (after.y - corner.y) - (corner.y - before.y) * (after.x - corner.x);
            const double longest = fmin(arm, fmax(hypot(corner.x - before.x, corner.y - before.y),
                                                  hypot(corner.x - after.x, corner.y - after.y)));
            double cut = 0.0;
            if (fabs(turn) > 1e-3)
                for (double step = longest; step > 0.25; step *= 0.5)
                    if (cut + step <= longest &&
                        !band_near(band, towards(corner, before, cut + step), towards(corner, after, cut + step)))
                        cut += step;
            if (cut <= 0.0 || !band_insert(band, i + 1, towards(corner, after, cut))) {
                i++;
                continue;
            }
            band->path[i] = towards(corner, before, cut);
            i += 2;
        }
    }
}

/* Moves a path, which is accurate to within a cell, to a distance of `radius` cells from the squares of `occupied` cells.
 * `path` holds `count` points and has room for `capacity`. Returns the new count, or -1 if there is no room. */
static int64_t lay_round(const uint8_t *occupied, int64_t height, int64_t width, Vec2 *path, int64_t count, int64_t capacity,
                         double radius) {
    /* Between two free centers of the grid, the distance may be less than the radius by a few thousandths of a cell. */
    Band band = {occupied, height, width, radius - 0.02, path, count, capacity};
    if (!band_push(&band)) return -1;
    band_cut(&band);
    return band.count;
}
