/* The filter of Matsubara et al. (2012) over blocks of eight channels: sums over channels of the E-step and the M-step,
   and the forecast. The equations stand in matsubara_filter.pyx, which calls these. */
#ifndef STYLE_MATSUBARA_H
#define STYLE_MATSUBARA_H

#include "lanes.h"

typedef struct {
    int count, blocks, channels, width;
    const double *noise;
    double *seen, *clean, *sums;   /* (width), (width), (J (J + 1) + J, 4) */
    double w[MOST], spread[MOST * MOST];
    double information, score, squares, logs;
} matsubara;

#define STYLE_BODY "matsubara_body.h"
#include "twice.h"

static inline void matsubara_innovate(matsubara *f, const cubic *at, double extra, const double *y,
                                      const unsigned char *observed)
{ BEST(matsubara_innovate, f, at, extra, y, observed); }
static inline void matsubara_maximise(matsubara *f, const cubic *at) { BEST(matsubara_maximise, f, at); }
static inline void matsubara_forecast(const matsubara *f, const cubic *at, double extra, double phase_variance,
                                      double speed, double *mean, double *std, double *velocity)
{ BEST(matsubara_forecast, f, at, extra, phase_variance, speed, mean, std, velocity); }

#endif
