/* Ranking phases at a glance, over blocks of eight channels (see glance.pyx). */
#ifndef STYLE_GLANCE_H
#define STYLE_GLANCE_H

#include "lanes.h"

/* Mean motion (blocks, nodes, 8) and at each of the phases the variances (blocks, phases, 8); the last samples by
   block, y and whether seen (blocks, samples, 8); whether a channel has any of them, and one over how many or 0. It
   only ranks, so all of it is in single precision. */
typedef struct {
    int blocks, nodes, samples;
    const float *mean, *posture, *log_posture, *change;   /* inverse variances and log of the first */
    const float *y, *seen, *any, *over;
    float most;              /* that a channel's posture or change may cost */
    float *totals;           /* scratch: (phases, 8) */
} glance;

#define STYLE_BODY "glance_body.h"
#include "twice.h"

static inline void glance_scores(glance *f, int count, const int *node, double *scores)
{ BEST(glance_scores, f, count, node, scores); }

#endif
