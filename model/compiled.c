/* Compiled forms of what model/ computes most often; called through ctypes by model/compiled.py, which checks every array.
 *
 * C99 without Python.h: nothing is allocated, no state is kept, so that any thread or copied process may call it. Each
 * function repeats a numpy one, step for step; tests/model/test_compiled.py holds them against each other.
 *
 *   contact   model/wheel_soil/contact.py   Eq. 7-9 with derivatives by the entries of Patch
 *   balance   model/wheel_soil/balance.py   the sinkage that carries the load
 *   whiten    model/diagnosis/time_series/whitening.py   the Kalman filter
 */

#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#ifndef SOURCE_HASH
#define SOURCE_HASH ""
#endif

/* Which source this was built from: a library that is older than its source is not used. */
EXPORT const char *source_hash(void) { return SOURCE_HASH; }

/* Entries of Patch, in its order. */
enum { ENTRY, RATIO, RADIUS, WIDTH, COHESION, TAN_PHI, MODULUS, STIFFNESS, EXPONENT, PEAK, EXIT, LUG, SOFTENING, ENTRIES };
/* Resultants, in their order. */
enum { LOAD_S, LOAD_C, PULL_S, PULL_C, TORQUE_S, TORQUE_C, RESULTANTS };
/* Integrals over a patch: of sigma (without k), E sigma and E, against 1, drop and advance. */
enum { SUMS = 9 };

#define SOFTENING_LENGTH_M 0.15

typedef struct {
    int64_t count;
    const double *at, *left, *weights;
} Rule;

/* Rules of one number of nodes: the stress vanishes at the start, at the end, or at neither. */
typedef struct {
    Rule start, end, none;
} Rules;

static Rule rule_of(int64_t count, const double *numbers) {
    Rule rule = {count, numbers, numbers + count, numbers + 2 * count};
    return rule;
}

static Rules rules_of(int64_t count, const double *numbers) {
    Rules rules = {rule_of(count, numbers), rule_of(count, numbers + 3 * count), rule_of(count, numbers + 6 * count)};
    return rules;
}

static double smaller(double a, double b) { return a < b || a != a ? a : b; } /* of NaN: NaN, as numpy */
static double larger(double a, double b) { return a > b || a != a ? a : b; }

/* An end of a panel in delta, with its derivatives by entry, peak and exit angle. */
typedef struct {
    double at, by[3];
} End;

static const int ANGLES[3] = {ENTRY, PEAK, EXIT};

/* What all nodes of a sample share. */
typedef struct {
    const double *p;
    double cos1, sin1, rate;
    unsigned wanted;
    int braking, of_angles;
} Sample;

typedef struct {
    double value[SUMS], by[ENTRIES][SUMS];
} Sums;

static void add_products(double *sums, double w, double sigma, double e_sigma, double e, double drop, double advance) {
    sums[0] += w * sigma;
    sums[1] += w * sigma * drop;
    sums[2] += w * sigma * advance;
    sums[3] += w * e_sigma;
    sums[4] += w * e_sigma * drop;
    sums[5] += w * e_sigma * advance;
    sums[6] += w * e;
    sums[7] += w * e * drop;
    sums[8] += w * e * advance;
}

/* Add the integrals over one panel, and their derivatives: the nodes move with the ends. */
static void add_panel(Sums *total, const Sample *s, End start, End stop, const Rule *rule, int rear) {
    const double *p = s->p;
    const double radius = p[RADIUS], ratio = p[RATIO], lug = p[LUG], n = p[EXPONENT], q = p[SOFTENING];
    const double span = stop.at - start.at, rear_width = p[PEAK] - p[EXIT], front = p[ENTRY] - p[PEAK];
    const unsigned wanted = s->wanted;
    double span_by[3];
    Sums own;
    memset(own.value, 0, sizeof own.value);
    if (wanted) memset(own.by, 0, sizeof own.by);
    for (int a = 0; a < 3; a++) span_by[a] = stop.by[a] - start.by[a];
    for (int64_t i = 0; i < rule->count; i++) {
        const double w = rule->weights[i], delta = start.at + span * rule->at[i];
        const double half = sin(delta * 0.5), square = half * half, a = square + square;
        const double sin_d = 2.0 * (half * sqrt(1.0 - square));
        const double drop = s->sin1 * sin_d - s->cos1 * a, advance = s->sin1 * a + s->cos1 * sin_d;
        double share = 0.0, level = drop, level_slope = 0.0, level_by_entry = 0.0;
        if (rear) {
            share = rule->left[i];
            if (rear_width != 0.0) share = (p[ENTRY] - p[EXIT] - stop.at + span * rule->left[i]) / rear_width;
            const double mirrored = share * front, h2 = sin(mirrored * 0.5), s2 = h2 * h2, a2 = s2 + s2;
            const double sin_m = 2.0 * (h2 * sqrt(1.0 - s2));
            level = s->sin1 * sin_m - s->cos1 * a2;
            level_slope = s->sin1 * (1.0 - a2) - s->cos1 * sin_m;
            level_by_entry = s->cos1 * sin_m + s->sin1 * a2;
        }
        const double log_depth = log(radius * level), sigma = exp(n * log_depth);
        double j = radius * (delta - ratio * advance) + lug * delta;
        const double sign = !s->braking ? 1.0 : (j > 0.0) - (j < 0.0);
        const double size = j != j ? j : sign * j, left = expm1(size * s->rate);
        double e = -sign * left, e_by_j = -sign * sign * (left + 1.0) * s->rate;
        double e_by_modulus = -sign * size * s->rate * s->rate * (left + 1.0), e_by_q = 0.0;
        if (q != 0.0 || wanted >> SOFTENING & 1u) {
            const double fall = expm1(size * (-1.0 / SOFTENING_LENGTH_M)), soft = 1.0 + q * fall;
            e_by_q = e * fall;
            e_by_j = e_by_j * soft + e * q * (fall + 1.0) * sign * (-1.0 / SOFTENING_LENGTH_M);
            e_by_modulus *= soft;
            e *= soft;
        }
        add_products(own.value, w, sigma, e * sigma, e, drop, advance);
        if (!wanted) continue;
        const double by_entry[5][2] = {
            {RATIO, e_by_j * -radius * advance},
            {RADIUS, e_by_j * (delta - ratio * advance)},
            {LUG, e_by_j * delta},
            {MODULUS, e_by_modulus},
            {SOFTENING, e_by_q},
        };
        for (int k = 0; k < 5; k++) {
            const int entry = (int)by_entry[k][0];
            if (wanted >> entry & 1u)
                add_products(own.by[entry], w, 0.0, by_entry[k][1] * sigma, by_entry[k][1], drop, advance);
        }
        if (wanted >> EXPONENT & 1u)
            add_products(own.by[EXPONENT], w, sigma * log_depth, e * sigma * log_depth, 0.0, drop, advance);
        if (!s->of_angles) continue;
        const double drop_slope = s->sin1 * (1.0 - a) - s->cos1 * sin_d;
        const double advance_slope = s->sin1 * sin_d + s->cos1 * (1.0 - a);
        for (int k = 0; k < 3; k++) {
            const int entry = ANGLES[k];
            if (!(wanted >> entry & 1u)) continue;
            const double own_turn = entry == ENTRY, moves = start.by[k] + span_by[k] * rule->at[i];
            const double drop_by = own_turn * advance + drop_slope * moves;
            const double advance_by = own_turn * -drop + advance_slope * moves;
            double level_by = drop_by;
            if (rear) {
                double share_by = 0.0;
                if (rear_width != 0.0) {
                    const double width_by = (entry == PEAK) - (entry == EXIT);
                    const double from_exit_by =
                        own_turn - (entry == EXIT) - stop.by[k] + span_by[k] * rule->left[i];
                    share_by = (from_exit_by - share * width_by) / rear_width;
                }
                level_by = own_turn * level_by_entry +
                           level_slope * (share_by * front + share * (own_turn - (entry == PEAK)));
            }
            const double sigma_by = sigma * n * (level_by / level);
            const double e_by = e_by_j * (radius * (moves - ratio * advance_by) + lug * moves);
            const double e_sigma = e * sigma, e_sigma_by = e_by * sigma + e * sigma_by;
            double *to = own.by[entry];
            add_products(to, w, sigma_by, e_sigma_by, e_by, drop, advance);
            to[1] += w * sigma * drop_by;
            to[2] += w * sigma * advance_by;
            to[4] += w * e_sigma * drop_by;
            to[5] += w * e_sigma * advance_by;
            to[7] += w * e * drop_by;
            to[8] += w * e * advance_by;
        }
    }
    for (int i = 0; i < SUMS; i++) total->value[i] += span * own.value[i];
    for (int entry = 0; wanted && entry < ENTRIES; entry++)
        if (wanted >> entry & 1u)
            for (int i = 0; i < SUMS; i++) total->by[entry][i] += span * own.by[entry][i];
    for (int k = 0; s->of_angles && k < 3; k++)
        if (wanted >> ANGLES[k] & 1u)
            for (int i = 0; i < SUMS; i++) total->by[ANGLES[k]][i] += span_by[k] * own.value[i];
}

/* Where a braked patch is split: at j = 0, else behind the layer in which shear builds up. */
static double braking_cut(const double *p, double end) {
    const double theta = p[ENTRY], kappa = p[RATIO], rise = 1.0 - kappa * cos(theta);
    double delta = end;
    for (int i = 0; i < 12; i++) {
        const double value = delta - kappa * 2.0 * cos(theta - 0.5 * delta) * sin(0.5 * delta);
        const double slope = 1.0 - kappa * cos(theta - delta);
        if (!(slope < 0.0 && value < 0.0)) break;
        delta -= value / slope;
    }
    if (rise > 0.0 && delta > 1e-9 * end && delta < end) return delta;
    return smaller(12.0 * p[MODULUS] / (p[RADIUS] * larger(-rise, 1e-12)), 0.5 * end);
}

/* Integrals against cos theta, sin theta and 1, from those against 1, drop and advance. */
static void by_direction(const Sample *s, const double *sums, double *turned) {
    turned[0] = s->cos1 * sums[0] + sums[1];
    turned[1] = s->sin1 * sums[0] - sums[2];
    turned[2] = sums[0];
}

/* Eq. 7-9 from the nine integrals, without r b. */
static void combine(const double *p, double turned[3][3], double *out) {
    const double c = p[COHESION], t = p[TAN_PHI], r = p[RADIUS] + p[LUG];
    out[LOAD_S] = turned[0][0] + t * turned[1][1];
    out[LOAD_C] = c * turned[2][1];
    out[PULL_S] = t * turned[1][0] - turned[0][1];
    out[PULL_C] = c * turned[2][0];
    out[TORQUE_S] = r * t * turned[1][2];
    out[TORQUE_C] = r * c * turned[2][2];
}

/* Integrals of sigma and E sigma are those without k, times k. */
static void turn_all(const Sample *s, const double *sums, double k, double turned[3][3]) {
    double scaled[SUMS];
    for (int i = 0; i < SUMS; i++) scaled[i] = i < 6 ? k * sums[i] : sums[i];
    for (int i = 0; i < 3; i++) by_direction(s, scaled + 3 * i, turned[i]);
}

/* Resultants of one patch, and their derivatives by the wanted entries. */
static void integrate(const double *p, const Rules *driving, const Rules *braked, unsigned wanted, double *out,
                      double by[ENTRIES][RESULTANTS]) {
    const Sample s = {p,
                      cos(p[ENTRY]),
                      sin(p[ENTRY]),
                      -1.0 / p[MODULUS],
                      wanted,
                      p[RATIO] > 1.0,
                      (wanted & (1u << ENTRY | 1u << PEAK | 1u << EXIT)) != 0};
    const End top = {0.0, {0.0, 0.0, 0.0}}, peak = {p[ENTRY] - p[PEAK], {1.0, -1.0, 0.0}},
              exit = {p[ENTRY] - p[EXIT], {1.0, 0.0, -1.0}};
    const int rear = p[PEAK] - p[EXIT] != 0.0 || wanted & (1u << PEAK | 1u << EXIT);
    Sums sums;
    memset(sums.value, 0, sizeof sums.value);
    if (wanted) memset(sums.by, 0, sizeof sums.by);
    if (!s.braking) {
        add_panel(&sums, &s, top, peak, &driving->start, 0);
        if (rear) add_panel(&sums, &s, peak, exit, &driving->end, 1);
    } else {
        const double cut = braking_cut(p, exit.at);
        const End in_front = {smaller(cut, peak.at), {0.0, 0.0, 0.0}}, behind = {larger(cut, peak.at), {0.0, 0.0, 0.0}};
        add_panel(&sums, &s, top, in_front, &braked->start, 0);
        add_panel(&sums, &s, in_front, peak, &braked->start, 0);
        if (rear) {
            add_panel(&sums, &s, peak, behind, &braked->none, 1);
            add_panel(&sums, &s, behind, exit, &braked->end, 1);
        }
    }
    const double k = p[STIFFNESS], area = p[RADIUS] * p[WIDTH], arm = p[RADIUS] + p[LUG];
    double turned[3][3], plain[RESULTANTS];
    turn_all(&s, sums.value, k, turned);
    combine(p, turned, plain);
    for (int i = 0; i < RESULTANTS; i++) out[i] = area * plain[i];
    for (int entry = 0; wanted && entry < ENTRIES; entry++) {
        if (!(wanted >> entry & 1u)) continue;
        double moved[3][3], *found = by[entry];
        if (entry == STIFFNESS) {
            memcpy(sums.by[entry], sums.value, 6 * sizeof(double));
            turn_all(&s, sums.by[entry], 1.0, moved);
        } else {
            if (entry == RADIUS)
                for (int i = 0; i < 6; i++) sums.by[entry][i] += p[EXPONENT] / p[RADIUS] * sums.value[i];
            turn_all(&s, sums.by[entry], k, moved);
        }
        if (entry == ENTRY)
            for (int i = 0; i < 3; i++) {
                moved[i][0] -= s.sin1 * turned[i][2];
                moved[i][1] += s.cos1 * turned[i][2];
            }
        combine(p, moved, found);
        if (entry == TAN_PHI) {
            found[LOAD_S] += turned[1][1];
            found[PULL_S] += turned[1][0];
            found[TORQUE_S] += arm * turned[1][2];
        } else if (entry == COHESION) {
            found[LOAD_C] += turned[2][1];
            found[PULL_C] += turned[2][0];
            found[TORQUE_C] += arm * turned[2][2];
        }
        if (entry == RADIUS || entry == LUG) {
            found[TORQUE_S] += p[TAN_PHI] * turned[1][2];
            found[TORQUE_C] += p[COHESION] * turned[2][2];
        }
        const double area_by = entry == RADIUS ? p[WIDTH] : entry == WIDTH ? p[RADIUS] : 0.0;
        for (int i = 0; i < RESULTANTS; i++) found[i] = area * found[i] + area_by * plain[i];
    }
}

static void gather(double *p, const double *const *entries, const int64_t *strides, int64_t i) {
    for (int entry = 0; entry < ENTRIES; entry++) p[entry] = entries[entry][strides[entry] * i];
}

/* Eq. 7-9 of n patches.
 *
 * entries, strides: of each entry its numbers, and 1, or 0 where one number serves all samples.
 * nodes, numbers: of a rule, when driving; the rules (start, end, none) of `at`, `left` and `weights`, then those of
 * 2 * nodes when braking.
 * wanted: bit i asks for the derivatives by entry i.
 * out: (6, n); by: (wanted entries, 6, n).
 */
EXPORT void contact(int64_t n, const double *const *entries, const int64_t *strides, int64_t nodes,
                    const double *numbers, uint32_t wanted, double *out, double *by) {
    const Rules driving = rules_of(nodes, numbers), braked = rules_of(2 * nodes, numbers + 9 * nodes);
    double p[ENTRIES], found[RESULTANTS], slopes[ENTRIES][RESULTANTS];
    for (int64_t i = 0; i < n; i++) {
        double *to = by + i;
        gather(p, entries, strides, i);
        integrate(p, &driving, &braked, wanted, found, slopes);
        for (int k = 0; k < RESULTANTS; k++) out[k * n + i] = found[k];
        for (int entry = 0; entry < ENTRIES; entry++)
            if (wanted >> entry & 1u)
                for (int k = 0; k < RESULTANTS; k++, to += n) *to = slopes[entry][k];
    }
}

/* The sinkage that carries the load: a secant method on ln W against ln Z, inside a bracket.
 *
 * As `contact`, without the entry angle, which follows from the sinkage; load, start, sinkage: (n).
 */
EXPORT void balance(int64_t n, const double *const *entries, const int64_t *strides, int64_t nodes,
                    const double *numbers, double tolerance, double first, double deepest, const double *load,
                    const double *start, double *sinkage) {
    const Rules driving = rules_of(nodes, numbers), braked = rules_of(2 * nodes, numbers + 9 * nodes);
    double p[ENTRIES], found[RESULTANTS];
    for (int64_t i = 0; i < n; i++) {
        gather(p, entries, strides, i);
        const double target = log(load[i]), radius = p[RADIUS];
        double low = -INFINITY, high = log(deepest * radius), slope = p[EXPONENT] + 0.5, old_y = NAN, old_miss = NAN;
        double y = smaller(log(isfinite(start[i]) && start[i] > 0.0 ? start[i] : first * radius), high - 1e-3);
        sinkage[i] = NAN;
        for (int turn = 0; turn < 60; turn++) {
            const double share = exp(y) / radius;
            p[ENTRY] = share > 0.0 && share <= 1.0 ? 2.0 * asin(sqrt(0.5 * share)) : NAN;
            integrate(p, &driving, &braked, 0, found, NULL);
            const double miss = log(larger(found[LOAD_S] + found[LOAD_C], 1e-300)) - target;
            if (miss != miss) break;
            if (miss < 0.0) low = y;
            if (miss > 0.0) high = y;
            const double latest = (miss - old_miss) / (y - old_y);
            if (isfinite(latest) && latest > 1e-3) slope = latest;
            double step = y - larger(smaller(miss / slope, 2.0), -2.0);
            if ((step <= low || step >= high) && fabs(miss) > tolerance)
                step = 0.5 * ((isfinite(low) ? low : high - 2.0) + high);
            if (fabs(miss) < tolerance || high - low < 1e-13) {
                if (fabs(miss) < 1e-3) sinkage[i] = exp(step);
                break;
            }
            old_y = y;
            old_miss = miss;
            y = step;
        }
    }
}

/* Processes of which a sample sees the values a block later and a block before: positions of their states. */
typedef struct {
    int64_t count;
    const int64_t *later, *now, *before;
} Near;

/* What is left of states (s, m) a step later, in place. */
static void move(double *restrict x, int64_t s, int64_t m, const double *decay, const double *shares, const Near *near) {
    for (int64_t l = 0; l < near->count; l++) {
        const double of_later = shares[l], before_of_later = shares[near->count + l],
                     before_of_now = shares[2 * near->count + l];
        double *later = x + near->later[l] * m, *now = x + near->now[l] * m, *before = x + near->before[l] * m;
        for (int64_t k = 0; k < m; k++) {
            before[k] = before_of_later * later[k] + before_of_now * now[k];
            now[k] = of_later * later[k];
        }
    }
    for (int64_t i = 0; i < s; i++) {
        int replaced = 0;
        for (int64_t l = 0; l < near->count; l++) replaced |= i == near->now[l] || i == near->before[l];
        if (!replaced)
            for (int64_t k = 0; k < m; k++) x[i * m + k] *= decay[i];
    }
}

static void transpose(double *x, int64_t s) {
    for (int64_t i = 0; i < s; i++)
        for (int64_t k = 0; k < i; k++) {
            const double kept = x[i * s + k];
            x[i * s + k] = x[k * s + i];
            x[k * s + i] = kept;
        }
}

/* The states' covariance a step later, in place. */
static void move_covariance(double *x, const double *stationary, int64_t s, const double *decay, const double *shares,
                            const Near *near) {
    for (int64_t i = 0; i < s * s; i++) x[i] -= stationary[i];
    move(x, s, s, decay, shares, near);
    transpose(x, s);
    move(x, s, s, decay, shares, near);
    for (int64_t i = 0; i < s * s; i++) x[i] += stationary[i];
}

/* Divide columns by the Cholesky factor of the noise's covariance.
 *
 * sizes: runs R, samples N, channels C, states S, columns M, neighbours L.
 * loadings (R, N, C, S); decay (R, N, S); stationary (S, S); white (R, N, C); later, now, before (L);
 * shares (R, N, 3, L); columns, out (R, N, C, M); log_determinants (R); work (S M + S S + 2 S).
 */
EXPORT void whiten(const int64_t *sizes, const double *loadings, const double *decay, const double *stationary,
                   const double *white, const int64_t *later, const int64_t *now, const int64_t *before,
                   const double *shares, const double *columns, double *restrict out, double *log_determinants,
                   double *work) {
    const int64_t runs = sizes[0], samples = sizes[1], channels = sizes[2], s = sizes[3], m = sizes[4];
    const Near near = {sizes[5], later, now, before};
    double *restrict state = work, *restrict covariance = work + s * m, *restrict loaded = covariance + s * s,
           *restrict gain = loaded + s;
    for (int64_t run = 0; run < runs; run++) {
        memset(state, 0, (size_t)(s * m) * sizeof(double));
        memcpy(covariance, stationary, (size_t)(s * s) * sizeof(double));
        log_determinants[run] = 0.0;
        for (int64_t i = 0; i < samples; i++) {
            const int64_t at = run * samples + i;
            if (i) {
                move(state, s, m, decay + at * s, shares + at * 3 * near.count, &near);
                move_covariance(covariance, stationary, s, decay + at * s, shares + at * 3 * near.count, &near);
            }
            for (int64_t c = 0; c < channels; c++) {
                const double *h = loadings + (at * channels + c) * s, *data = columns + (at * channels + c) * m;
                double *restrict innovation = out + (at * channels + c) * m, variance = 0.0;
                for (int64_t k = 0; k < s; k++) {
                    double sum = 0.0;
                    for (int64_t l = 0; l < s; l++) sum += covariance[k * s + l] * h[l];
                    loaded[k] = sum;
                    variance += sum * h[k];
                }
                variance += white[at * channels + c];
                for (int64_t k = 0; k < m; k++) innovation[k] = data[k];
                for (int64_t k = 0; k < s; k++)
                    if (h[k] != 0.0)
                        for (int64_t l = 0; l < m; l++) innovation[l] -= h[k] * state[k * m + l];
                for (int64_t k = 0; k < s; k++) {
                    gain[k] = loaded[k] / variance;
                    for (int64_t l = 0; l < m; l++) state[k * m + l] += gain[k] * innovation[l];
                    for (int64_t l = 0; l < s; l++) covariance[k * s + l] -= gain[k] * loaded[l];
                }
                const double scale = sqrt(variance);
                for (int64_t k = 0; k < m; k++) innovation[k] /= scale;
                log_determinants[run] += log(variance);
            }
        }
    }
}
