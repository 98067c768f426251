/* Blocks of eight channels: vector types, the functions on half a block that all kernels share, and the choice of the
   instruction set.

   A kernel's body is compiled twice, for any processor and for AVX2, with NAME() the suffix of its functions, and
   BEST() calls one of the two at run time. Without fused multiply-add both give the same bits. */
#ifndef STYLE_LANES_H
#define STYLE_LANES_H

#include <math.h>
#include <string.h>

#define TWO_PI 6.283185307179586
#define LANES 8
#define MOST 60  /* common states, and states of a channel */

/* Tables are kept in single precision: what that rounds is a thousandth of what lies between nodes, and half the
   memory passes through the caches. All arithmetic is in double precision. */
typedef float cell;
typedef cell c4 __attribute__((vector_size(4 * sizeof(cell)), may_alias));
typedef double v4 __attribute__((vector_size(32), may_alias));
typedef long long l4 __attribute__((vector_size(32), may_alias));
typedef double v4u __attribute__((vector_size(32), aligned(8), may_alias));
typedef float f8 __attribute__((vector_size(32), may_alias));
typedef int i8 __attribute__((vector_size(32), may_alias));

/* The cubics between two nodes of a table, each a row of blocks of (value, slope) of every basis. A cubic is
   h[0] p + h[1] q + h[2] r + h[3] s of value and slope here (p, q) and at the next node (r, s), and its derivative by
   phase is the same with h[4..7] (docs/phase_style.md, eq. 1). */
typedef struct { const cell *here, *next; double h[8]; } cubic;

/* Weights of the cubic at the share u of the way between two nodes, of which there are rate to a unit of phase. */
static inline void cubic_weights(cubic *at, double u, double rate)
{
    at->h[0] = (1 + 2 * u) * (1 - u) * (1 - u);
    at->h[1] = u * (1 - u) * (1 - u);
    at->h[2] = u * u * (3 - 2 * u);
    at->h[3] = u * u * (u - 1);
    at->h[4] = 6 * u * (u - 1) * rate;
    at->h[5] = (1 - u) * (1 - 3 * u) * rate;
    at->h[6] = -at->h[4];
    at->h[7] = u * (3 * u - 2) * rate;
}

/* The cubic with weights h (its value with h, its derivative with h + 4), of numbers or of vectors. */
#define CUBIC(h, p, q, r, s) (((h)[0] * (p) + (h)[1] * (q)) + ((h)[2] * (r) + (h)[3] * (s)))

static inline double cubic_of(const double *h, double p, double q, double r, double s)
{ return CUBIC(h, p, q, r, s); }

/* both halves of a block */
#define EACH for (int k = 0; k < 2; k++)
/* a row of a block, and half of one */
#define ROW(base, r) ((v4 *)((base) + LANES * (r)))
#define CROW(base, r) ((const v4 *)((base) + LANES * (r)))
#define CHALF(base, r) (*(const v4 *)((base) + LANES * (r)))
/* a basis in half a block of a cubic's node: its value, and its slope */
#define VALUE(base, j) NAME(wide)((base) + 2 * LANES * (j))
#define SLOPE(base, j) NAME(wide)((base) + 2 * LANES * (j) + LANES)
/* place of an element of a lower triangle */
#define TRI(a, b) ((a) * ((a) + 1) / 2 + (b))

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && defined(__gnu_linux__)
#define STYLE_AVX2
#include <immintrin.h>
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

#define STYLE_BODY "lanes_body.h"
#include "twice.h"

static inline void between(double share, const double *a, const double *b, double *out, int n)
{ for (int k = 0; k < n; k++) out[k] = (1 - share) * a[k] + share * b[k]; }

#endif
