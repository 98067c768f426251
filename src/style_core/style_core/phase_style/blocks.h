/* The inner loops of the filters, over blocks of eight channels.

   A block's states lie together, so that all that happens to them in one pass stays in the first-level cache. The
   code is compiled twice, for any processor and for AVX2, and chosen at run time; without fused multiply-add both
   give the same bits. The equations are in docs/phase_style.md, the names those of kernel.pyx. */
#ifndef STYLE_BLOCKS_H
#define STYLE_BLOCKS_H

#include <math.h>
#include <string.h>

#define TWO_PI 6.283185307179586
#define LANES 8
#define MOST 60  /* common states, and residual states of a channel */

/* Tables are kept in single precision: what that rounds is a thousandth of what lies between nodes, and half the
   memory passes through the caches. All arithmetic is in double precision. */
typedef float cell;
typedef cell c4 __attribute__((vector_size(4 * sizeof(cell)), may_alias));
typedef double v4 __attribute__((vector_size(32), may_alias));
typedef long long l4 __attribute__((vector_size(32), may_alias));
typedef double v4u __attribute__((vector_size(32), aligned(8), may_alias));
typedef float f8 __attribute__((vector_size(32), may_alias));
typedef int i8 __attribute__((vector_size(32), may_alias));

/* The cubics between two nodes of a table, each a row of blocks of (value, slope) of every basis; weights of the value
   in h[0..3] and of its derivative by phase in h[4..7]: value and slope here, value and slope at the next node. */
typedef struct { const cell *here, *next; double h[8]; } cubic;

/* Rows of a block of the arrow filter: A (n, m), V (n (n + 1) / 2, below its diagonal), u (n), g (m), V s (n),
   1 / S, error, then constants: noise, offset, fast, sum of personal, personal (K). */
typedef struct {
    int m, n, harmonics, blocks, channels, width, rows, third;
    int blank;               /* the states are to be at their priors, but the memory has not been filled in */
    double *states;
    double *sums;            /* (m (m + 1) / 2 + m + 1, 4): G^T S^-1 G, G^T S^-1 e, e^T S^-1 e */
    double logs;             /* log det S */
    double worst;            /* largest e^2 / S of a channel */
    const double *y;
    const unsigned char *observed;
    /* time step */
    double dt, rho, f11, f12, f21, f22, fast_rate;
    double load[3][3], back[3][3], mix[3][MOST], decay[MOST], renewal[3];
    /* linearisation */
    double w[MOST], s[MOST], thin;
    cubic at;
    double delta[MOST];      /* change of the common state */
    double factor[MOST * MOST];  /* its covariance's root */
} arrow;

/* A time ahead: where the table is looked up, and how today's states enter. */
typedef struct {
    cubic at;
    double w[MOST], s[MOST];
    double ahead, speed, rho, f21, f22, offset_rate, personal_rate, style_rate;
    double q_offset, q_fast, q_personal, wander;
} horizon;

typedef struct {
    int count, blocks, channels, width;
    const double *noise;
    double *seen, *clean, *sums;   /* (width), (width), (J (J + 1) + J, 4) */
    double w[MOST], spread[MOST * MOST];
    double information, score, squares, logs;
} paper;

/* Mean motion (blocks, nodes, 8) and at each of the phases the variances (blocks, phases, 8); the last samples by block,
   y and whether seen (blocks, samples, 8); whether a channel has any of them, and one over how many or 0. It only ranks,
   so all of it is in single precision. */
typedef struct {
    int blocks, nodes, samples;
    const float *mean, *posture, *log_posture, *change;   /* inverse variances and log of the first */
    const float *y, *seen, *any, *over;
    float most;              /* that a channel's posture or change may cost */
    float *totals;           /* scratch: (phases, 8) */
} glance;

#define NAME(x) x##_plain
#include "blocks_body.h"
#undef NAME

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && defined(__gnu_linux__)
#include <immintrin.h>
#pragma GCC push_options
#pragma GCC target("avx2")
#define NAME(x) x##_avx2
#include "blocks_body.h"
#undef NAME
#pragma GCC pop_options
static int has_avx2(void)
{
    static int answer = -1;
    if (answer < 0) answer = __builtin_cpu_supports("avx2") ? 1 : 0;
    return answer;
}
#define BEST(name, ...) (has_avx2() ? name##_avx2(__VA_ARGS__) : name##_plain(__VA_ARGS__))
#else
#define BEST(name, ...) name##_plain(__VA_ARGS__)
#endif

static inline void arrow_sense(arrow *f, int step) { BEST(arrow_sense, f, step); }
static inline void arrow_fill(arrow *f) { BEST(arrow_fill, f); }
static inline void arrow_settle(arrow *f) { BEST(arrow_settle, f); }
static inline void arrow_mean(const arrow *f, const horizon *x, double *mean, double *velocity, double *rows)
{ BEST(arrow_mean, f, x, mean, velocity, rows); }
static inline void arrow_spread(const arrow *f, const horizon *x, int count, const double *rows,
                                double *const *std)
{ BEST(arrow_spread, f, x, count, rows, std); }
static inline void paper_sense(paper *f, const cubic *at, double extra, const double *y,
                               const unsigned char *observed)
{ BEST(paper_sense, f, at, extra, y, observed); }
static inline void paper_learn(paper *f, const cubic *at) { BEST(paper_learn, f, at); }
static inline void paper_ahead(const paper *f, const cubic *at, double extra, double phase_variance, double speed,
                               double *mean, double *std, double *velocity)
{ BEST(paper_ahead, f, at, extra, phase_variance, speed, mean, std, velocity); }
static inline void glance_scores(glance *f, int count, const int *node, double *scores)
{ BEST(glance_scores, f, count, node, scores); }
static inline void between(double share, const double *a, const double *b, double *out, int n)
{ for (int k = 0; k < n; k++) out[k] = (1 - share) * a[k] + share * b[k]; }

#endif
