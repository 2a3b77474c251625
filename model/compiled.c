/* Compiled forms of what model/ computes most often; called through ctypes by model/compiled.py, which checks every array.
 *
 * C99 without Python.h: nothing is allocated, no state is kept, so that any thread or copied process may call it. Each
 * function repeats a numpy one, step for step; tests/model/test_compiled.py holds them against each other.
 *
 *   contact   model/wheel_soil/contact.py   Eq. 7-9 with derivatives by the entries of Patch
 *   balance   model/wheel_soil/balance.py   the sinkage that carries the load
 *   whiten, smooth_back   model/diagnosis/time_series/whitening.py   the Kalman filter and smoother
 *   kernels, add_covariance, slope_products, slope_traces   model/diagnosis/time_series/hyper.py   the noise's likelihood
 *   weigh     model/diagnosis/time_series/evidence.py   the evidence of sets of causes
 */

#include <math.h>
#include <stdint.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#if defined(__GNUC__)
#define ALWAYS_INLINE static inline __attribute__((always_inline))
#else
#define ALWAYS_INLINE static inline
#endif

/* The same operations four or eight at a time where the processor can; which numbers come out does not depend on it. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__) && !defined(__SANITIZE_ADDRESS__)
#define CLONED __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CLONED
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
#define ROOT_HALF 0.70710678118654752440
#define LOG_SQRT_2PI 0.91893853320467274178

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

/* Samples go side by side, one in each lane, so that a compiler can use vector instructions without changing a sum. */
enum { LANES = 32 };
#define EACH_LANE for (int l = 0; l < LANES; l++)

static double double_of(uint64_t bits) {
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static uint64_t bits_of(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

ALWAYS_INLINE int all_within(const double *x, double low, double high) {
    uint64_t outside = 0; /* as wide as a double, for a vector instruction */
    EACH_LANE outside |= (x[l] >= low) & (x[l] <= high) ? 0 : 1;
    return !outside;
}

/* sin x: its series up to x^21 for |x| <= 1.6, whose rest is below 1e-17. */
ALWAYS_INLINE void sin_lanes(const double *x, double *out) {
    if (!all_within(x, -1.6, 1.6)) {
        EACH_LANE out[l] = sin(x[l]);
        return;
    }
    EACH_LANE {
        const double z = x[l] * x[l];
        double sum = 1.0 / 51090942171709440000.0;
        sum = sum * z - 1.0 / 121645100408832000.0;
        sum = sum * z + 1.0 / 355687428096000.0;
        sum = sum * z - 1.0 / 1307674368000.0;
        sum = sum * z + 1.0 / 6227020800.0;
        sum = sum * z - 1.0 / 39916800.0;
        sum = sum * z + 1.0 / 362880.0;
        sum = sum * z - 1.0 / 5040.0;
        sum = sum * z + 1.0 / 120.0;
        sum = sum * z - 1.0 / 6.0;
        out[l] = x[l] + x[l] * z * sum;
    }
}

#define LN2_HIGH 6.93147180369123816490e-01
#define LN2_LOW 1.90821492927058770002e-10
#define INTEGER 6755399441055744.0 /* 1.5 * 2^52: added to a number, it leaves its nearest integer in the last bits */

/* exp x - 1 = 2^k (1 + series) - 1, r = x - k ln 2; the series' rest is below 1e-17 r. Returns 2^k, too. */
ALWAYS_INLINE double exp_series(double x, double *series) {
    const double at = x * 1.44269504088896338700 + INTEGER, k = at - INTEGER;
    const double r = (x - k * LN2_HIGH) - k * LN2_LOW;
    double sum = 1.0 / 6227020800.0;
    sum = sum * r + 1.0 / 479001600.0;
    sum = sum * r + 1.0 / 39916800.0;
    sum = sum * r + 1.0 / 3628800.0;
    sum = sum * r + 1.0 / 362880.0;
    sum = sum * r + 1.0 / 40320.0;
    sum = sum * r + 1.0 / 5040.0;
    sum = sum * r + 1.0 / 720.0;
    sum = sum * r + 1.0 / 120.0;
    sum = sum * r + 1.0 / 24.0;
    sum = sum * r + 1.0 / 6.0;
    sum = sum * r + 0.5;
    *series = r + r * r * sum;
    return double_of((bits_of(at) << 52) + ((uint64_t)1023 << 52));
}

ALWAYS_INLINE void exp_lanes(const double *x, double *out) {
    if (!all_within(x, -700.0, 700.0)) {
        EACH_LANE out[l] = exp(x[l]);
        return;
    }
    EACH_LANE {
        double series;
        const double power = exp_series(x[l], &series);
        out[l] = power + power * series;
    }
}

/* exp x - 1; that of -60 is -1 to the last digit. */
ALWAYS_INLINE void expm1_lanes(const double *given, double *out) {
    double x[LANES];
    EACH_LANE x[l] = given[l] < -60.0 ? -60.0 : given[l];
    if (!all_within(x, -60.0, 700.0)) {
        EACH_LANE out[l] = expm1(x[l]);
        return;
    }
    EACH_LANE {
        double series;
        const double power = exp_series(x[l], &series);
        out[l] = power * series + (power - 1.0);
    }
}

/* ln x, after fdlibm (Sun Microsystems, 1993): x = 2^k (1 + f), s = f / (2 + f). */
ALWAYS_INLINE void log_lanes(const double *x, double *out) {
    if (!all_within(x, 1e-300, 1e300)) {
        EACH_LANE out[l] = log(x[l]);
        return;
    }
    EACH_LANE {
        const uint64_t bits = bits_of(x[l]), root_half = 0x3fe6a09e667f3bcdULL, one = (uint64_t)1023 << 52;
        const uint64_t power = (bits + (one - root_half)) >> 52;
        const double k = double_of(power | 0x4330000000000000ULL) - (4503599627370496.0 + 1023.0);
        const double f = double_of(bits - (power << 52) + one) - 1.0, s = f / (2.0 + f), z = s * s;
        double r = 1.479819860511658591e-01;
        r = r * z + 1.531383769920937332e-01;
        r = r * z + 1.818357216161805012e-01;
        r = r * z + 2.222219843214978396e-01;
        r = r * z + 2.857142874366239149e-01;
        r = r * z + 3.999999999940941908e-01;
        r = r * z + 6.666666666666735130e-01;
        const double half = 0.5 * f * f;
        out[l] = k * LN2_HIGH - ((half - (s * (half + r * z) + k * LN2_LOW)) - f);
    }
}

/* An end of a panel in delta, with its derivatives by entry, peak and exit angle. */
typedef struct {
    double at[LANES], by[3];
} End;

static const int ANGLES[3] = {ENTRY, PEAK, EXIT};

/* Samples that all drive or all brake, and what their nodes share. */
typedef struct {
    double p[ENTRIES][LANES], cos1[LANES], sin1[LANES], rate[LANES];
    unsigned wanted;
    int braking, of_angles;
} Batch;

typedef struct {
    double value[SUMS][LANES], by[ENTRIES][SUMS][LANES];
} Sums;

/* Integrands of one node. */
typedef struct {
    double sigma[LANES], e_sigma[LANES], e[LANES];
} Node;

ALWAYS_INLINE void add_products(double sums[SUMS][LANES], double w, const Node *y, const double *drop, const double *advance) {
    const double *listed[3] = {y->sigma, y->e_sigma, y->e};
    for (int i = 0; i < 3; i++) {
        const double *x = listed[i];
        EACH_LANE sums[3 * i][l] += w * x[l];
        EACH_LANE sums[3 * i + 1][l] += w * x[l] * drop[l];
        EACH_LANE sums[3 * i + 2][l] += w * x[l] * advance[l];
    }
}

ALWAYS_INLINE void geometry(const Batch *s, const double *delta, double *sin_d, double *a, double *drop, double *advance) {
    double x[LANES], half[LANES];
    EACH_LANE x[l] = delta[l] * 0.5;
    sin_lanes(x, half);
    EACH_LANE {
        const double square = half[l] * half[l];
        a[l] = square + square; /* 1 - cos delta */
        sin_d[l] = 2.0 * (half[l] * sqrt(1.0 - square));
        drop[l] = s->sin1[l] * sin_d[l] - s->cos1[l] * a[l];
        advance[l] = s->sin1[l] * a[l] + s->cos1[l] * sin_d[l];
    }
}

/* Add the integrals over one panel, and their derivatives: the nodes move with the ends. */
CLONED static void add_panel(Sums *total, const Batch *s, const End *start, const End *stop, const Rule *rule, int rear) {
    const double *n = s->p[EXPONENT], *radius = s->p[RADIUS], *ratio = s->p[RATIO], *lug = s->p[LUG];
    const double *entry_angle = s->p[ENTRY], *q = s->p[SOFTENING];
    const unsigned wanted = s->wanted;
    double span[LANES], span_by[3], front[LANES], rear_width[LANES];
    int softens = (int)(wanted >> SOFTENING & 1u);
    Sums own;
    memset(own.value, 0, sizeof own.value);
    for (int entry = 0; entry < ENTRIES; entry++)
        if (wanted >> entry & 1u) memset(own.by[entry], 0, sizeof own.by[entry]);
    for (int a = 0; a < 3; a++) span_by[a] = stop->by[a] - start->by[a];
    EACH_LANE {
        span[l] = stop->at[l] - start->at[l];
        front[l] = entry_angle[l] - s->p[PEAK][l];
        rear_width[l] = s->p[PEAK][l] - s->p[EXIT][l];
        softens |= q[l] != 0.0;
    }
    for (int64_t i = 0; i < rule->count; i++) {
        const double w = rule->weights[i], at = rule->at[i], left_of = rule->left[i];
        double delta[LANES], sin_d[LANES], a[LANES], drop[LANES], advance[LANES], share[LANES], level[LANES];
        double level_slope[LANES], level_by_entry[LANES], depth[LANES], log_depth[LANES], power[LANES];
        double j[LANES], sign[LANES], size[LANES], x[LANES], left[LANES], e_by_j[LANES];
        double e_by[ENTRIES][LANES];
        Node y, slope;
        EACH_LANE delta[l] = start->at[l] + span[l] * at;
        geometry(s, delta, sin_d, a, drop, advance);
        if (rear) {
            double mirrored[LANES], sin_m[LANES], a_m[LANES];
            EACH_LANE {
                const double wide = rear_width[l] != 0.0 ? rear_width[l] : 1.0;
                const double from_exit = entry_angle[l] - s->p[EXIT][l] - stop->at[l] + span[l] * left_of;
                share[l] = rear_width[l] != 0.0 ? from_exit / wide : left_of;
                mirrored[l] = share[l] * front[l];
            }
            geometry(s, mirrored, sin_m, a_m, level, level_by_entry);
            EACH_LANE level_slope[l] = s->sin1[l] * (1.0 - a_m[l]) - s->cos1[l] * sin_m[l];
        } else
            memcpy(level, drop, sizeof level);
        EACH_LANE depth[l] = radius[l] * level[l];
        log_lanes(depth, log_depth);
        EACH_LANE power[l] = n[l] * log_depth[l];
        exp_lanes(power, y.sigma);
        EACH_LANE {
            j[l] = radius[l] * (delta[l] - ratio[l] * advance[l]) + lug[l] * delta[l];
            sign[l] = !s->braking ? 1.0 : j[l] > 0.0 ? 1.0 : j[l] < 0.0 ? -1.0 : 0.0 * j[l];
            size[l] = sign[l] * j[l];
            x[l] = size[l] * s->rate[l];
        }
        expm1_lanes(x, left);
        EACH_LANE {
            y.e[l] = -sign[l] * left[l];
            e_by_j[l] = -sign[l] * sign[l] * (left[l] + 1.0) * s->rate[l];
            e_by[SOFTENING][l] = 0.0;
            e_by[MODULUS][l] = -sign[l] * size[l] * s->rate[l] * s->rate[l] * (left[l] + 1.0);
        }
        if (softens) {
            double fall[LANES];
            EACH_LANE x[l] = size[l] * (-1.0 / SOFTENING_LENGTH_M);
            expm1_lanes(x, fall);
            EACH_LANE {
                const double soft = 1.0 + q[l] * fall[l], e = y.e[l];
                e_by[SOFTENING][l] = e * fall[l];
                e_by_j[l] = e_by_j[l] * soft + e * q[l] * (fall[l] + 1.0) * sign[l] * (-1.0 / SOFTENING_LENGTH_M);
                e_by[MODULUS][l] *= soft;
                y.e[l] = e * soft;
            }
        }
        EACH_LANE y.e_sigma[l] = y.e[l] * y.sigma[l];
        add_products(own.value, w, &y, drop, advance);
        if (!wanted) continue;
        EACH_LANE {
            e_by[RATIO][l] = e_by_j[l] * -radius[l] * advance[l];
            e_by[RADIUS][l] = e_by_j[l] * (delta[l] - ratio[l] * advance[l]);
            e_by[LUG][l] = e_by_j[l] * delta[l];
        }
        static const int OF_SHEAR[] = {RATIO, RADIUS, LUG, MODULUS, SOFTENING};
        for (int k = 0; k < 5; k++) {
            const int entry = OF_SHEAR[k];
            if (!(wanted >> entry & 1u)) continue;
            EACH_LANE {
                slope.sigma[l] = 0.0;
                slope.e_sigma[l] = e_by[entry][l] * y.sigma[l];
                slope.e[l] = e_by[entry][l];
            }
            add_products(own.by[entry], w, &slope, drop, advance);
        }
        if (wanted >> EXPONENT & 1u) {
            EACH_LANE {
                slope.sigma[l] = y.sigma[l] * log_depth[l];
                slope.e_sigma[l] = y.e_sigma[l] * log_depth[l];
                slope.e[l] = 0.0;
            }
            add_products(own.by[EXPONENT], w, &slope, drop, advance);
        }
        for (int k = 0; s->of_angles && k < 3; k++) {
            const int entry = ANGLES[k];
            if (!(wanted >> entry & 1u)) continue;
            const double of_entry = entry == ENTRY, of_peak = entry == PEAK, of_exit = entry == EXIT;
            const double moves = start->by[k] + span_by[k] * at;
            const double from_exit_by = of_entry - of_exit - stop->by[k] + span_by[k] * left_of;
            double drop_by[LANES], advance_by[LANES], level_by[LANES];
            EACH_LANE {
                const double drop_slope = s->sin1[l] * (1.0 - a[l]) - s->cos1[l] * sin_d[l];
                const double advance_slope = s->sin1[l] * sin_d[l] + s->cos1[l] * (1.0 - a[l]);
                drop_by[l] = level_by[l] = of_entry * advance[l] + drop_slope * moves;
                advance_by[l] = of_entry * -drop[l] + advance_slope * moves;
            }
            if (rear)
                EACH_LANE {
                    const double wide = rear_width[l] != 0.0 ? rear_width[l] : 1.0;
                    const double turned = (from_exit_by - share[l] * (of_peak - of_exit)) / wide;
                    const double share_by = rear_width[l] != 0.0 ? turned : 0.0;
                    level_by[l] = of_entry * level_by_entry[l] +
                                  level_slope[l] * (share_by * front[l] + share[l] * (of_entry - of_peak));
                }
            EACH_LANE {
                slope.sigma[l] = y.sigma[l] * n[l] * (level_by[l] / level[l]);
                slope.e[l] = e_by_j[l] * (radius[l] * (moves - ratio[l] * advance_by[l]) + lug[l] * moves);
                slope.e_sigma[l] = slope.e[l] * y.sigma[l] + y.e[l] * slope.sigma[l];
            }
            add_products(own.by[entry], w, &slope, drop, advance);
            const double *listed[3] = {y.sigma, y.e_sigma, y.e};
            for (int m = 0; m < 3; m++) {
                EACH_LANE own.by[entry][3 * m + 1][l] += w * listed[m][l] * drop_by[l];
                EACH_LANE own.by[entry][3 * m + 2][l] += w * listed[m][l] * advance_by[l];
            }
        }
    }
    for (int i = 0; i < SUMS; i++) EACH_LANE total->value[i][l] += span[l] * own.value[i][l];
    for (int entry = 0; entry < ENTRIES; entry++)
        if (wanted >> entry & 1u)
            for (int i = 0; i < SUMS; i++) EACH_LANE total->by[entry][i][l] += span[l] * own.by[entry][i][l];
    for (int k = 0; k < 3; k++)
        if (wanted >> ANGLES[k] & 1u)
            for (int i = 0; i < SUMS; i++) EACH_LANE total->by[ANGLES[k]][i][l] += span_by[k] * own.value[i][l];
}

/* Where braked patches are split: at j = 0, else behind the layer in which shear builds up. */
ALWAYS_INLINE void braking_cut(const Batch *s, const double *end, double *cut) {
    double x[LANES], half[LANES];
    uint64_t moving = 1;
    memcpy(cut, end, sizeof x);
    for (int i = 0; i < 12 && moving; i++) {
        EACH_LANE x[l] = 0.5 * cut[l];
        sin_lanes(x, half);
        moving = 0;
        EACH_LANE {
            const double cos1 = s->cos1[l], sin1 = s->sin1[l], kappa = s->p[RATIO][l];
            const double rest = sqrt(1.0 - half[l] * half[l]);
            const double value = cut[l] - kappa * 2.0 * (cos1 * rest + sin1 * half[l]) * half[l];
            const double slope = 1.0 - kappa * (cos1 * (1.0 - 2.0 * half[l] * half[l]) + sin1 * 2.0 * half[l] * rest);
            const double next = (slope < 0.0) & (value < 0.0) ? cut[l] - value / slope : cut[l];
            moving |= next != cut[l] ? 1 : 0;
            cut[l] = next;
        }
    }
    EACH_LANE {
        const double rise = 1.0 - s->p[RATIO][l] * s->cos1[l], layer = 12.0 * s->p[MODULUS][l] / s->p[RADIUS][l];
        const int crosses = (rise > 0.0) & (cut[l] > 1e-9 * end[l]) & (cut[l] < end[l]);
        if (!crosses) cut[l] = smaller(layer / larger(-rise, 1e-12), 0.5 * end[l]);
    }
}

/* Eq. 7-9 from the nine integrals, without r b; those against 1, drop and advance become those by direction. */
static void combine(const double *p, double turned[3][3], double *out) {
    const double c = p[COHESION], t = p[TAN_PHI], r = p[RADIUS] + p[LUG];
    out[LOAD_S] = turned[0][0] + t * turned[1][1];
    out[LOAD_C] = c * turned[2][1];
    out[PULL_S] = t * turned[1][0] - turned[0][1];
    out[PULL_C] = c * turned[2][0];
    out[TORQUE_S] = r * t * turned[1][2];
    out[TORQUE_C] = r * c * turned[2][2];
}

/* Integrals of sigma, E sigma and E against cos theta, sin theta and 1; the first two are without k. */
static void turn(double cos1, double sin1, double k, double sums[SUMS][LANES], int l, double turned[3][3]) {
    for (int i = 0; i < 3; i++) {
        const double by = i < 2 ? k : 1.0;
        const double one = by * sums[3 * i][l], drop = by * sums[3 * i + 1][l], advance = by * sums[3 * i + 2][l];
        turned[i][0] = cos1 * one + drop;
        turned[i][1] = sin1 * one - advance;
        turned[i][2] = one;
    }
}

/* Resultants of the sample in a lane, and their derivatives by the wanted entries. */
static void resultants_of(const Batch *s, Sums *sums, int l, double *out, double by[ENTRIES][RESULTANTS]) {
    double p[ENTRIES], turned[3][3], plain[RESULTANTS];
    for (int entry = 0; entry < ENTRIES; entry++) p[entry] = s->p[entry][l];
    const double cos1 = s->cos1[l], sin1 = s->sin1[l], k = p[STIFFNESS];
    const double area = p[RADIUS] * p[WIDTH], arm = p[RADIUS] + p[LUG];
    turn(cos1, sin1, k, sums->value, l, turned);
    combine(p, turned, plain);
    for (int i = 0; i < RESULTANTS; i++) out[i] = area * plain[i];
    for (int entry = 0; entry < ENTRIES; entry++) {
        if (!(s->wanted >> entry & 1u)) continue;
        double moved[3][3], *found = by[entry];
        if (entry == STIFFNESS)
            for (int i = 0; i < 6; i++) sums->by[entry][i][l] = sums->value[i][l];
        if (entry == RADIUS)
            for (int i = 0; i < 6; i++) sums->by[entry][i][l] += p[EXPONENT] / p[RADIUS] * sums->value[i][l];
        turn(cos1, sin1, entry == STIFFNESS ? 1.0 : k, sums->by[entry], l, moved);
        if (entry == ENTRY)
            for (int i = 0; i < 3; i++) {
                moved[i][0] -= sin1 * turned[i][2];
                moved[i][1] += cos1 * turned[i][2];
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

/* Integrate a batch over all its panels. */
CLONED static void integrate(Batch *s, const Rules *rules, Sums *sums) {
    End top = {{0.0}, {0.0, 0.0, 0.0}}, peak = {{0.0}, {1.0, -1.0, 0.0}}, exit = {{0.0}, {1.0, 0.0, -1.0}};
    int rear = (s->wanted & (1u << PEAK | 1u << EXIT)) != 0;
    s->of_angles = (s->wanted & (1u << ENTRY | 1u << PEAK | 1u << EXIT)) != 0;
    double half[LANES], sin_half[LANES];
    EACH_LANE half[l] = 0.5 * s->p[ENTRY][l];
    sin_lanes(half, sin_half);
    EACH_LANE {
        s->cos1[l] = 1.0 - 2.0 * sin_half[l] * sin_half[l];
        s->sin1[l] = 2.0 * sin_half[l] * sqrt(1.0 - sin_half[l] * sin_half[l]);
        s->rate[l] = -1.0 / s->p[MODULUS][l];
        peak.at[l] = s->p[ENTRY][l] - s->p[PEAK][l];
        exit.at[l] = s->p[ENTRY][l] - s->p[EXIT][l];
        rear |= s->p[PEAK][l] - s->p[EXIT][l] != 0.0;
    }
    memset(sums->value, 0, sizeof sums->value);
    for (int entry = 0; entry < ENTRIES; entry++)
        if (s->wanted >> entry & 1u) memset(sums->by[entry], 0, sizeof sums->by[entry]);
    if (!s->braking) {
        add_panel(sums, s, &top, &peak, &rules->start, 0);
        if (rear) add_panel(sums, s, &peak, &exit, &rules->end, 1);
        return;
    }
    End in_front = {{0.0}, {0.0, 0.0, 0.0}}, behind = {{0.0}, {0.0, 0.0, 0.0}};
    double cut[LANES];
    braking_cut(s, exit.at, cut);
    EACH_LANE {
        in_front.at[l] = smaller(cut[l], peak.at[l]);
        behind.at[l] = larger(cut[l], peak.at[l]);
    }
    add_panel(sums, s, &top, &in_front, &rules->start, 0);
    add_panel(sums, s, &in_front, &peak, &rules->start, 0);
    if (rear) {
        add_panel(sums, s, &peak, &behind, &rules->none, 1);
        add_panel(sums, s, &behind, &exit, &rules->end, 1);
    }
}

/* Entries of patches: of each its numbers, and 1, or 0 where one number serves all samples. */
typedef struct {
    int64_t count;
    const double *const *entries;
    const int64_t *strides;
} Patches;

static void fill(Batch *s, int l, const Patches *patches, int64_t i) {
    for (int entry = 0; entry < ENTRIES; entry++)
        s->p[entry][l] = patches->entries[entry][patches->strides[entry] * i];
}

/* The first sample from i on that brakes, or does not; the number of samples where there is none. */
static int64_t next_of(const Patches *patches, int64_t i, int braking) {
    while (i < patches->count && (patches->entries[RATIO][patches->strides[RATIO] * i] > 1.0) != braking) i++;
    return i;
}

/* Eq. 7-9 of n patches.
 *
 * entries, strides: see Patches.
 * nodes, numbers: of a rule, when driving; the rules (start, end, none) of `at`, `left` and `weights`, then those of
 * 2 * nodes when braking.
 * wanted: bit i asks for the derivatives by entry i.
 * out: (6, n); by: (wanted entries, 6, n).
 */
EXPORT void contact(int64_t n, const double *const *entries, const int64_t *strides, int64_t nodes,
                    const double *numbers, uint32_t wanted, double *out, double *by) {
    const Rules rules[2] = {rules_of(nodes, numbers), rules_of(2 * nodes, numbers + 9 * nodes)};
    const Patches patches = {n, entries, strides};
    double found[RESULTANTS], slopes[ENTRIES][RESULTANTS];
    Batch s;
    Sums sums;
    s.wanted = wanted;
    for (s.braking = 0; s.braking < 2; s.braking++) {
        for (int64_t i = next_of(&patches, 0, s.braking); i < n;) {
            int64_t at[LANES];
            int used = 0;
            for (; used < LANES && i < n; used++, i = next_of(&patches, i + 1, s.braking)) at[used] = i;
            EACH_LANE fill(&s, l, &patches, at[l < used ? l : 0]);
            integrate(&s, &rules[s.braking], &sums);
            for (int l = 0; l < used; l++) {
                double *to = by + at[l];
                resultants_of(&s, &sums, l, found, slopes);
                for (int k = 0; k < RESULTANTS; k++) out[k * n + at[l]] = found[k];
                for (int entry = 0; entry < ENTRIES; entry++)
                    if (wanted >> entry & 1u)
                        for (int k = 0; k < RESULTANTS; k++, to += n) *to = slopes[entry][k];
            }
        }
    }
}

/* The search of one sample: ln Z, and where it was before. */
typedef struct {
    int64_t sample;
    int turns;
    double target, low, high, slope, y, old_y, old_miss;
} Search;

/* Take a step by ln W - ln of the load; return whether the search is over, and what it has found. */
static int step_on(Search *of, double carried, double tolerance, double *found) {
    const double miss = log(larger(carried, 1e-300)) - of->target;
    *found = NAN;
    if (miss != miss) return 1;
    if (miss < 0.0) of->low = of->y;
    if (miss > 0.0) of->high = of->y;
    const double latest = (miss - of->old_miss) / (of->y - of->old_y);
    if (isfinite(latest) && latest > 1e-3) of->slope = latest;
    double step = of->y - larger(smaller(miss / of->slope, 2.0), -2.0);
    if ((step <= of->low || step >= of->high) && fabs(miss) > tolerance)
        step = 0.5 * ((isfinite(of->low) ? of->low : of->high - 2.0) + of->high);
    if (fabs(miss) < tolerance || of->high - of->low < 1e-13) {
        if (fabs(miss) < 1e-3) *found = exp(step);
        return 1;
    }
    of->old_y = of->y;
    of->old_miss = miss;
    of->y = step;
    return ++of->turns == 60;
}

/* The sinkage that carries the load: a secant method on ln W against ln Z, inside a bracket.
 *
 * As `contact`, without the entry angle, which follows from the sinkage; load, start, sinkage: (n). A lane whose search
 * is over takes the next sample.
 */
EXPORT void balance(int64_t n, const double *const *entries, const int64_t *strides, int64_t nodes,
                    const double *numbers, double tolerance, double first, double deepest, const double *load,
                    const double *start, double *sinkage) {
    const Rules rules[2] = {rules_of(nodes, numbers), rules_of(2 * nodes, numbers + 9 * nodes)};
    const Patches patches = {n, entries, strides};
    Batch s;
    Sums sums;
    Search of[LANES];
    s.wanted = 0;
    for (s.braking = 0; s.braking < 2; s.braking++) {
        int64_t next = next_of(&patches, 0, s.braking);
        int busy = 0;
        if (next == n) continue;
        EACH_LANE {
            of[l].sample = -1;
            fill(&s, l, &patches, next);
        }
        do {
            EACH_LANE {
                if (of[l].sample < 0 && next < n) {
                    fill(&s, l, &patches, next);
                    const double radius = s.p[RADIUS][l], high = log(deepest * radius), guess = start[next];
                    const double y = log(isfinite(guess) && guess > 0.0 ? guess : first * radius);
                    const Search begun = {next, 0, log(load[next]), -INFINITY, high, s.p[EXPONENT][l] + 0.5,
                                          smaller(y, high - 1e-3), NAN, NAN};
                    of[l] = begun;
                    busy++;
                    next = next_of(&patches, next + 1, s.braking);
                }
                if (of[l].sample >= 0) {
                    const double share = exp(of[l].y) / s.p[RADIUS][l];
                    s.p[ENTRY][l] = share > 0.0 && share <= 1.0 ? 2.0 * asin(sqrt(0.5 * share)) : NAN;
                }
            }
            integrate(&s, &rules[s.braking], &sums);
            EACH_LANE {
                double found[RESULTANTS], solved;
                if (of[l].sample < 0) continue;
                resultants_of(&s, &sums, l, found, NULL);
                if (step_on(&of[l], found[LOAD_S] + found[LOAD_C], tolerance, &solved)) {
                    sinkage[of[l].sample] = solved;
                    of[l].sample = -1;
                    busy--;
                }
            }
        } while (busy || next < n);
    }
}

/* Processes of which a sample sees the values a block later and a block before: positions of their states. */
typedef struct {
    int64_t count;
    const int64_t *later, *now, *before;
} Near;

/* What is left of states (s, m) a step later, in place. */
ALWAYS_INLINE void move(double *restrict x, int64_t s, int64_t m, const double *decay, const double *shares, const Near *near) {
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

ALWAYS_INLINE void transpose(double *x, int64_t s) {
    for (int64_t i = 0; i < s; i++)
        for (int64_t k = 0; k < i; k++) {
            const double kept = x[i * s + k];
            x[i * s + k] = x[k * s + i];
            x[k * s + i] = kept;
        }
}

/* The states' covariance a step later, in place. */
ALWAYS_INLINE void move_covariance(double *x, const double *stationary, int64_t s, const double *decay, const double *shares,
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
 * means (R, N, S, M), covariances (R, N, S, S): of the states given the data so far; NULL: not kept.
 */
EXPORT CLONED void whiten(const int64_t *sizes, const double *loadings, const double *decay, const double *stationary,
                   const double *white, const int64_t *later, const int64_t *now, const int64_t *before,
                   const double *shares, const double *columns, double *restrict out, double *log_determinants,
                   double *means, double *covariances, double *work) {
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
                memset(loaded, 0, (size_t)s * sizeof(double));
                for (int64_t k = 0; k < s; k++) /* symmetric; most states load no one channel */
                    if (h[k] != 0.0)
                        for (int64_t l = 0; l < s; l++) loaded[l] += covariance[k * s + l] * h[k];
                for (int64_t k = 0; k < s; k++) variance += loaded[k] * h[k];
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
            if (means) memcpy(means + at * s * m, state, (size_t)(s * m) * sizeof(double));
            if (covariances) memcpy(covariances + at * s * s, covariance, (size_t)(s * s) * sizeof(double));
        }
    }
}

/* Solve a x = b in place by elimination with row pivots; a and b: (s, s). */
CLONED static void solve(double *a, double *b, int64_t s) {
    for (int64_t i = 0; i < s; i++) {
        int64_t pivot = i;
        for (int64_t k = i + 1; k < s; k++)
            if (fabs(a[k * s + i]) > fabs(a[pivot * s + i])) pivot = k;
        for (int64_t l = 0; pivot != i && l < s; l++) {
            const double kept_a = a[i * s + l], kept_b = b[i * s + l];
            a[i * s + l] = a[pivot * s + l];
            b[i * s + l] = b[pivot * s + l];
            a[pivot * s + l] = kept_a;
            b[pivot * s + l] = kept_b;
        }
        for (int64_t k = i + 1; k < s; k++) {
            const double by = a[k * s + i] / a[i * s + i];
            if (by == 0.0) continue;
            for (int64_t l = i; l < s; l++) a[k * s + l] -= by * a[i * s + l];
            for (int64_t l = 0; l < s; l++) b[k * s + l] -= by * b[i * s + l];
        }
    }
    for (int64_t i = s - 1; i >= 0; i--)
        for (int64_t l = 0; l < s; l++) {
            double sum = b[i * s + l];
            for (int64_t k = i + 1; k < s; k++) sum -= a[i * s + k] * b[k * s + l];
            b[i * s + l] = sum / a[i * s + i];
        }
}

/* Go back over a run's filtered means (samples, s) and covariances (samples, s, s), and smooth them in place.
 *
 * After Rauch, Tung & Striebel (1965); decay (samples, s), shares (samples, 3, neighbours) of the steps to each sample.
 */
EXPORT CLONED void smooth_back(const int64_t *sizes, const double *decay, const double *stationary, const int64_t *later,
                        const int64_t *now, const int64_t *before, const double *shares, double *means,
                        double *covariances, double *work) {
    const int64_t samples = sizes[0], s = sizes[1], square = s * s;
    const Near near = {sizes[2], later, now, before};
    double *ahead = work, *back = work + square, *lu = work + 2 * square, *step = work + 3 * square, *mean = step + square;
    for (int64_t i = samples - 2; i >= 0; i--) {
        const double *own_decay = decay + (i + 1) * s, *own_shares = shares + (i + 1) * 3 * near.count;
        double *own = covariances + i * square;
        const double *next = own + square;
        memcpy(ahead, own, (size_t)square * sizeof(double));
        move_covariance(ahead, stationary, s, own_decay, own_shares, &near);
        memcpy(back, own, (size_t)square * sizeof(double));
        move(back, s, s, own_decay, own_shares, &near);
        memcpy(lu, ahead, (size_t)square * sizeof(double));
        solve(lu, back, s);
        memcpy(mean, means + i * s, (size_t)s * sizeof(double));
        move(mean, s, 1, own_decay, own_shares, &near);
        for (int64_t k = 0; k < s; k++)
            for (int64_t l = 0; l < s; l++) means[i * s + l] += back[k * s + l] * (means[(i + 1) * s + k] - mean[k]);
        for (int64_t k = 0; k < square; k++) ahead[k] = next[k] - ahead[k];
        for (int64_t k = 0; k < s; k++)
            for (int64_t l = 0; l < s; l++) {
                double sum = 0.0;
                for (int64_t m = 0; m < s; m++) sum += ahead[k * s + m] * back[m * s + l];
                step[k * s + l] = sum;
            }
        for (int64_t k = 0; k < s; k++)
            for (int64_t l = 0; l < s; l++) {
                double sum = 0.0;
                for (int64_t m = 0; m < s; m++) sum += back[m * s + k] * step[m * s + l];
                own[k * s + l] += sum;
            }
    }
}

/* Processes of a noise over sites, and what each measured number sees of them: of a process p and a site i the entries
 * from starts[p (sites + 1) + i] to the next, each the position of a number and a load. */
typedef struct {
    int64_t processes, sites, numbers;
    const int64_t *starts, *at;
    const double *loads;
} Seen;

static Seen seen_of(const int64_t *sizes, const int64_t *starts, const int64_t *at, const double *loads) {
    const Seen seen = {sizes[0], sizes[1], sizes[2], starts, at, loads};
    return seen;
}

/* exp(-lag / time) of each process, (processes, sites, sites); of time 0 the identity.
 *
 * lags: (2, sites, sites), by time and by distance; over_distance: which of them.
 */
EXPORT CLONED void kernels(int64_t processes, int64_t sites, const double *lags, const int64_t *over_distance,
                           const double *times, double *out) {
    const int64_t square = sites * sites;
    for (int64_t p = 0; p < processes; p++) {
        const double *lag = lags + over_distance[p] * square, rate = -1.0 / times[p];
        double *to = out + p * square;
        if (times[p] == 0.0) {
            memset(to, 0, (size_t)square * sizeof(double));
            for (int64_t i = 0; i < sites; i++) to[i * sites + i] = 1.0;
            continue;
        }
        int64_t i = 0;
        for (; i + LANES <= square; i += LANES) {
            double x[LANES];
            EACH_LANE x[l] = lag[i + l] * rate;
            exp_lanes(x, to + i);
        }
        for (; i < square; i++) to[i] = exp(lag[i] * rate);
    }
}

/* Add the covariance of the processes, of variances sigma^2, to `out` (numbers, numbers); work: (sites, numbers). */
EXPORT CLONED void add_covariance(const int64_t *sizes, const int64_t *starts, const int64_t *at, const double *loads,
                                  const double *kernel, const double *sigmas, double *restrict out,
                                  double *restrict work) {
    const Seen seen = seen_of(sizes, starts, at, loads);
    const int64_t sites = seen.sites, m = seen.numbers;
    for (int64_t p = 0; p < seen.processes; p++) {
        const int64_t *from = starts + p * (sites + 1);
        const double *own = kernel + p * sites * sites, variance = sigmas[p] * sigmas[p];
        memset(work, 0, (size_t)(sites * m) * sizeof(double));
        for (int64_t j = 0; j < sites; j++)
            for (int64_t i = 0; i < sites; i++)
                for (int64_t e = from[i]; e < from[i + 1]; e++) work[j * m + at[e]] += own[j * sites + i] * loads[e];
        for (int64_t j = 0; j < sites; j++)
            for (int64_t e = from[j]; e < from[j + 1]; e++) {
                double *to = out + at[e] * m;
                const double by = variance * loads[e];
                for (int64_t k = 0; k < m; k++) to[k] += by * work[j * m + k];
            }
    }
}

/* Products of a vector x (numbers) with the covariance's derivatives by ln time and ln sigma, (processes, 2, numbers).
 *
 * work: (sites).
 */
EXPORT void slope_products(const int64_t *sizes, const int64_t *starts, const int64_t *at, const double *loads,
                           const double *kernel, const double *sigmas, const double *lags, const int64_t *over_distance,
                           const double *times, const double *x, double *out, double *work) {
    const Seen seen = seen_of(sizes, starts, at, loads);
    const int64_t sites = seen.sites, m = seen.numbers;
    memset(out, 0, (size_t)(seen.processes * 2 * m) * sizeof(double));
    for (int64_t p = 0; p < seen.processes; p++) {
        const int64_t *from = starts + p * (sites + 1);
        const double *own = kernel + p * sites * sites, *lag = lags + over_distance[p] * sites * sites;
        const double variance = sigmas[p] * sigmas[p], rate = times[p] == 0.0 ? 0.0 : 1.0 / times[p];
        double *by_site = work, *by_time = out + p * 2 * m, *by_sigma = by_time + m;
        for (int64_t i = 0; i < sites; i++) {
            by_site[i] = 0.0;
            for (int64_t e = from[i]; e < from[i + 1]; e++) by_site[i] += loads[e] * x[at[e]];
        }
        for (int64_t i = 0; i < sites; i++) {
            double plain = 0.0, lagged = 0.0;
            for (int64_t j = 0; j < sites; j++) {
                const double one = own[i * sites + j] * by_site[j];
                plain += one;
                lagged += lag[i * sites + j] * one;
            }
            for (int64_t e = from[i]; e < from[i + 1]; e++) {
                by_time[at[e]] += variance * rate * loads[e] * lagged;
                by_sigma[at[e]] += 2.0 * variance * loads[e] * plain;
            }
        }
    }
}

/* Traces of these derivatives with a symmetric matrix `other` (numbers, numbers), (processes, 2); work: (numbers). */
EXPORT CLONED void slope_traces(const int64_t *sizes, const int64_t *starts, const int64_t *at, const double *loads,
                                const double *kernel, const double *sigmas, const double *lags,
                                const int64_t *over_distance, const double *times, const double *other, double *out,
                                double *restrict work) {
    const Seen seen = seen_of(sizes, starts, at, loads);
    const int64_t sites = seen.sites, m = seen.numbers;
    for (int64_t p = 0; p < seen.processes; p++) {
        const int64_t *from = starts + p * (sites + 1);
        const double *own = kernel + p * sites * sites, *lag = lags + over_distance[p] * sites * sites;
        const double variance = sigmas[p] * sigmas[p], rate = times[p] == 0.0 ? 0.0 : 1.0 / times[p];
        double plain = 0.0, lagged = 0.0;
        for (int64_t i = 0; i < sites; i++) {
            if (from[i] == from[i + 1]) continue;
            memset(work, 0, (size_t)m * sizeof(double));
            for (int64_t e = from[i]; e < from[i + 1]; e++) {
                const double *row = other + at[e] * m, by = loads[e];
                for (int64_t k = 0; k < m; k++) work[k] += by * row[k];
            }
            for (int64_t j = 0; j < sites; j++) {
                double sum = 0.0;
                for (int64_t e = from[j]; e < from[j + 1]; e++) sum += work[at[e]] * loads[e];
                sum *= own[i * sites + j];
                plain += sum;
                lagged += sum * lag[i * sites + j];
            }
        }
        out[2 * p] = variance * rate * lagged;
        out[2 * p + 1] = 2.0 * variance * plain;
    }
}

/* ln of the probability that a standard normal number is below x; far out its series, whose rest is below 1e-12. */
static double log_normal(double x) {
    const double z = 1.0 / (x * x);
    if (x > 0.0) return log1p(-0.5 * erfc(x * ROOT_HALF));
    if (x > -35.0) return log(0.5 * erfc(-x * ROOT_HALF));
    return -0.5 * x * x - log(-x) - LOG_SQRT_2PI + log1p(-z * (1.0 - z * (3.0 - z * (15.0 - z * 105.0))));
}

/* The log probability of [a, b] under a standard normal, and mean and variance within. */
static double interval(double a, double b, double *mean, double *variance) {
    const int flip = a > 0.0;
    const double low = larger(flip ? -b : a, -3000.0), high = smaller(flip ? -a : b, 30.0);
    const double below_low = log_normal(low), below_high = log_normal(high);
    const double log_p = below_high + log1p(-exp(smaller(below_low - below_high, -1e-12)));
    const double at_low = exp(-0.5 * low * low - LOG_SQRT_2PI - log_p), at_high = exp(-0.5 * high * high - LOG_SQRT_2PI - log_p);
    const double within = at_low - at_high;
    *mean = flip ? -within : within;
    *variance = smaller(larger(1.0 + low * at_low - high * at_high - within * within, 1e-6), 1.0);
    return log_p;
}

/* Invert a positive definite matrix (m, m) in place; return ln of its determinant. */
static double invert(double *a, int64_t m) {
    double log_determinant = 0.0;
    for (int64_t k = 0; k < m; k++) {
        const double pivot = a[k * m + k];
        log_determinant += log(pivot);
        a[k * m + k] = 1.0;
        for (int64_t j = 0; j < m; j++) a[k * m + j] /= pivot;
        for (int64_t i = 0; i < m; i++) {
            const double factor = a[i * m + k];
            if (i == k) continue;
            a[i * m + k] = 0.0;
            for (int64_t j = 0; j < m; j++) a[i * m + j] -= factor * a[k * m + j];
        }
    }
    return log_determinant;
}

/* Of R replicates of S sets with m columns each: ln det of the precision, the residual's fall times two, and the log
 * probability of the box of bounds, (R, S) each.
 *
 * precision (m, m, R, S); side (m, R, S); lower, upper (m, S); work (m m + m).
 */
EXPORT void weigh(int64_t m, int64_t replicates, int64_t sets, const double *precision, const double *side,
                  const double *lower, const double *upper, double *log_determinants, double *falls, double *inside,
                  double *restrict work) {
    const int64_t count = replicates * sets;
    double *restrict mean = work + m * m;
    for (int64_t at = 0; at < count; at++) {
        for (int64_t i = 0; i < m * m; i++) work[i] = precision[i * count + at];
        log_determinants[at] = invert(work, m);
        falls[at] = inside[at] = 0.0;
        for (int64_t i = 0; i < m; i++) {
            mean[i] = 0.0;
            for (int64_t j = 0; j < m; j++) mean[i] += work[i * m + j] * side[j * count + at];
            falls[at] += side[i * count + at] * mean[i];
        }
        for (int64_t i = 0; i < m; i++) {
            const double sigma = sqrt(work[i * m + i]), *low = lower + i * sets, *high = upper + i * sets;
            double shift, variance;
            inside[at] += interval((low[at % sets] - mean[i]) / sigma, (high[at % sets] - mean[i]) / sigma, &shift, &variance);
            for (int64_t j = i + 1; j < m; j++) {
                const double gain = work[i * m + j] / sigma;
                mean[j] += gain * shift;
                for (int64_t k = i + 1; k < m; k++) work[j * m + k] -= gain * (work[i * m + k] / sigma) * (1.0 - variance);
            }
        }
    }
}
