/* The arrow filter over blocks of eight channels.

   A block's states lie together, so that all that happens to them in one pass stays in the first-level cache. The
   numbers of the equations are those of docs/phase_style.md, the names those of arrow_filter.pyx. */
#ifndef STYLE_ARROW_H
#define STYLE_ARROW_H

#include "lanes.h"

#define WIDEST 3  /* states of a part that depend on each other */

/* The states of a part that depend on each other: the first of them, their transition G, and in lower triangles, as
   multiples of the part's variance, the prior covariance and what is new after a time step, P0 - G P0 G^T. */
typedef struct {
    int first, size;
    double g[WIDEST * WIDEST], prior[6], fresh[6];
} coupled;

/* Rows of a block: A (n, m), V (n (n + 1) / 2, below its diagonal), u (n), g (m), V s (n), 1 / S, error, then what no
   update changes: noise, and the variance of each part (parts.pxd). What the states mean stands in the arrays below
   alone: a state decays by itself, or is one of several that are coupled. */
typedef struct {
    int m, n, parts, couples, blocks, channels, width, rows, third;
    int blank;               /* the states are to be at their priors, but the memory has not been filled in */
    double *states;
    double *sums;            /* (m (m + 1) / 2 + m + 1, 4): G^T S^-1 G, G^T S^-1 e, e^T S^-1 e */
    double logs;             /* log det S */
    double worst;            /* largest e^2 / S of a channel */
    const double *y;
    const unsigned char *observed;
    /* time step: eqs. (6) to (9) */
    double dt, rho;
    double load[3][3], back[3][3], mix[3][MOST];
    int part[MOST];          /* of each state */
    double decay[MOST], renewal[MOST];  /* of each state, 1 and 0 where it is coupled */
    coupled couple[MOST];
    /* linearisation: weights of bases and states, and the states' derivatives by phase */
    double w[MOST], s[MOST], by_phase[MOST], thin;
    cubic at;
    double delta[MOST];      /* change of the common state */
    double factor[MOST * MOST];  /* its covariance's root */
} arrow;

/* A time ahead: where the table is looked up, how the present states enter, how much of each part is new by then. */
typedef struct {
    cubic at;
    double w[MOST], s[MOST], by_phase[MOST], by_time[MOST];
    const double *fresh;
    double ahead, speed, rho, style_rate, wander;
    double apart[24];        /* horizons half a page apart would all lie in the same few lines of the cache */
} horizon;

/* First rows of what a block holds. */
static inline int arrow_v(const arrow *f) { return f->n * f->m; }
static inline int arrow_u(const arrow *f) { return arrow_v(f) + TRI(f->n, 0); }
static inline int arrow_g(const arrow *f) { return arrow_u(f) + f->n; }
static inline int arrow_vs(const arrow *f) { return arrow_g(f) + f->m; }
static inline int arrow_inverse(const arrow *f) { return arrow_vs(f) + f->n; }
static inline int arrow_error(const arrow *f) { return arrow_inverse(f) + 1; }
static inline int arrow_constants(const arrow *f) { return arrow_error(f) + 1; }
static inline int arrow_rows(const arrow *f) { return arrow_constants(f) + 1 + f->parts; }
/* A channel's number in a row; those of the rows after it follow every LANES. */
static inline double *arrow_cell(const arrow *f, int channel, int row)
{ return f->states + ((long)(channel / LANES) * f->rows + row) * LANES + channel % LANES; }
static inline int arrow_variance(const arrow *f, int state) { return arrow_v(f) + TRI(state, state); }

#define STYLE_BODY "arrow_body.h"
#include "twice.h"

static inline void arrow_innovate(arrow *f, int step) { BEST(arrow_innovate, f, step); }
static inline void arrow_fill(arrow *f) { BEST(arrow_fill, f); }
static inline void arrow_correct(arrow *f) { BEST(arrow_correct, f); }
static inline void arrow_mean(const arrow *f, const horizon *x, double *mean, double *velocity, double *rows)
{ BEST(arrow_mean, f, x, mean, velocity, rows); }
static inline void arrow_spread(const arrow *f, const horizon *x, int count, const double *rows,
                                double *const *std)
{ BEST(arrow_spread, f, x, count, rows, std); }

#endif
