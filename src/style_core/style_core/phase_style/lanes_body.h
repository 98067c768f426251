/* Included by twice.h once an instruction set: functions on half a block. */

/* four cells of a table */
static inline v4 NAME(wide)(const cell *x)
{
#ifdef __AVX__
    return (v4)_mm256_cvtps_pd(_mm_load_ps(x));
#else
    return __builtin_convertvector(*(const c4 *)x, v4);
#endif
}

/* half a block of a row of channels, which may end before or inside it */
static inline void NAME(put)(double *out, v4 x, int left)
{
    if (left >= LANES / 2)
        *(v4u *)out = x;
    else if (left > 0)
        memcpy(out, &x, left * sizeof(double));
}

/* weights of a cubic in all lanes */
static inline void NAME(spread_weights)(const cubic *at, v4 *h)
{
    for (int i = 0; i < 8; i++)
        h[i] = (v4){at->h[i], at->h[i], at->h[i], at->h[i]};
}

/* what was measured in a block, 0 where nothing was; returns whether anything was */
static inline int NAME(observed_of)(const double *y, const unsigned char *observed, int left, v4 *clean, v4 *seen)
{
    double *c = (double *)clean, *o = (double *)seen;
    int any = 0;
    for (int k = 0; k < LANES; k++) {
        int here = k < left && observed[k];
        o[k] = here ? 1.0 : 0.0;
        c[k] = here ? y[k] : 0.0;
        any |= here;
    }
    return any;
}

static inline double NAME(log_product)(const v4 *x)
{
    return log((x[0][0] * x[0][1]) * (x[0][2] * x[0][3])) + log((x[1][0] * x[1][1]) * (x[1][2] * x[1][3]));
}

/* square roots, 0 of what is not positive */
static inline v4 NAME(root)(v4 x)
{
    v4 y;
    x = (v4)((l4)x & (x > 0));
    for (int k = 0; k < LANES / 2; k++)
        y[k] = sqrt(x[k]);
    return y;
}

/* basis j in half a block: the cubic with weights h */
static inline v4 NAME(basis)(const v4 *h, const cell *here, const cell *next, int j)
{
    return CUBIC(h, VALUE(here, j), SLOPE(here, j), VALUE(next, j), SLOPE(next, j));
}

/* add a basis, weighted, to values and slopes at both nodes: x[0..1] here, x[2..3] at the next */
static inline void NAME(add_basis)(v4 *x, double weight, const cell *here, const cell *next, int j)
{
    x[0] += weight * VALUE(here, j);
    x[1] += weight * SLOPE(here, j);
    x[2] += weight * VALUE(next, j);
    x[3] += weight * SLOPE(next, j);
}
