/* Included by blocks.h once an instruction set, with NAME() the suffix of its functions. */
#define EACH for (int k = 0; k < 2; k++)
#define ROW(base, r) ((v4 *)((base) + LANES * (r)))
#define CROW(base, r) ((const v4 *)((base) + LANES * (r)))
/* half a row of a block */
#define HALF(base, r) (*(v4 *)((base) + LANES * (r)))
#define CHALF(base, r) (*(const v4 *)((base) + LANES * (r)))
/* a basis in half a block of a cubic's node: its value, and its slope */
#define VALUE(base, j) NAME(wide)((base) + 2 * LANES * (j))
#define SLOPE(base, j) NAME(wide)((base) + 2 * LANES * (j) + LANES)
#define TRI(a, b) ((a) * ((a) + 1) / 2 + (b))

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
static inline int NAME(take)(const double *y, const unsigned char *observed, int left, v4 *clean, v4 *seen)
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

/* States of a block at their priors, and independent of the common state. */
static inline void NAME(arrow_blank)(const arrow *f, double *A, double *V, const double *constants)
{
    memset(A, 0, (char *)constants - (char *)A);
    for (int a = 0; a < f->n; a++) {
        const v4 *prior = CROW(constants, a == 0 ? 1 : a < 3 ? 2 : 4 + (a - 3) / 2);
        const double rate = a == 2 ? f->fast_rate : 1.0;  /* the fast residual's velocity */
        EACH ROW(V, TRI(a, a))[k] = prior[k] * rate * rate;
    }
}

/* The same of all blocks. */
static void NAME(arrow_fill)(arrow *f)
{
    const int n = f->n, constants = f->rows - 4 - f->harmonics;
    for (int block = 0; block < f->blocks; block++) {
        double *A = f->states + (long)block * f->rows * LANES;
        NAME(arrow_blank)(f, A, A + LANES * n * f->m, A + LANES * constants);
    }
    f->blank = 0;
}

/* Time step of a block: V <- G (V + A N A^T) G^T + Q and A <- G A M, u <- G u. */
static inline void NAME(arrow_step)(const arrow *f, double *A, double *V, double *u, const double *constants)
{
    const int m = f->m, n = f->n, third = f->third;
    const double f11 = f->f11, f12 = f->f12, f21 = f->f21, f22 = f->f22, over = 1 / f->rho;
    v4 L[MOST][3][2];  /* A times the part of c that the new c does not tell */
    for (int a = 0; a < n; a++) {
        const v4 *x = ROW(A, a * m), *z = ROW(A, a * m + 1), *w = ROW(A, a * m + third);
        EACH {
            L[a][0][k] = f->back[0][0] * x[k] + f->back[1][0] * z[k] + f->back[2][0] * w[k];
            L[a][1][k] = f->back[0][1] * x[k] + f->back[1][1] * z[k] + f->back[2][1] * w[k];
            L[a][2][k] = f->back[2][2] * w[k];
        }
    }
    for (int a = 0; a < n; a++)
        for (int b = 0; b <= a; b++) {
            v4 *v = ROW(V, TRI(a, b));
            const double both = f->decay[a] * f->decay[b];
            EACH v[k] = both * (v[k] + (L[a][0][k] * L[b][0][k] + L[a][1][k] * L[b][1][k] + L[a][2][k] * L[b][2][k]));
        }
    {   /* the fast residual and its velocity */
        v4 *v10 = ROW(V, TRI(1, 0)), *v20 = ROW(V, TRI(2, 0));
        v4 *v11 = ROW(V, TRI(1, 1)), *v21 = ROW(V, TRI(2, 1)), *v22 = ROW(V, TRI(2, 2));
        const v4 *fast = CROW(constants, 2);
        const double r2 = f->fast_rate * f->fast_rate;
        const double q11 = 1 - f11 * f11 - r2 * f12 * f12, q21 = -f21 * f11 - r2 * f22 * f12;
        const double q22 = r2 - f21 * f21 - r2 * f22 * f22;
        EACH {
            v4 x = v10[k], z = v20[k], p = v11[k], q = v21[k], r = v22[k];
            v10[k] = f11 * x + f12 * z;
            v20[k] = f22 * z + f21 * x;
            v11[k] = f11 * f11 * p + 2 * f11 * f12 * q + f12 * f12 * r + q11 * fast[k];
            v21[k] = f21 * f11 * p + (f21 * f12 + f22 * f11) * q + f22 * f12 * r + q21 * fast[k];
            v22[k] = f21 * f21 * p + 2 * f21 * f22 * q + f22 * f22 * r + q22 * fast[k];
        }
        for (int a = 3; a < n; a++) {
            v4 *one = ROW(V, TRI(a, 1)), *two = ROW(V, TRI(a, 2));
            EACH {
                v4 x = one[k], z = two[k];
                one[k] = f11 * x + f12 * z;
                two[k] = f22 * z + f21 * x;
            }
        }
        EACH ROW(V, 0)[k] += f->renewal[0] * CROW(constants, 1)[k];
        for (int j = 0; j < f->harmonics; j++)
            for (int a = 3 + 2 * j; a < 5 + 2 * j; a++)
                EACH ROW(V, TRI(a, a))[k] += f->renewal[2] * CROW(constants, 4 + j)[k];
    }
    for (int a = 0; a < n; a++) {
        v4 *x = ROW(A, a * m), *z = ROW(A, a * m + 1), *w = ROW(A, a * m + third);
        const double decay = f->decay[a];
        v4 p[2], q[2], r[2];
        EACH z[k] -= f->dt * x[k];
        EACH w[k] *= over;
        EACH {
            p[k] = f->load[0][0] * x[k] + f->load[1][0] * z[k];
            q[k] = f->load[1][1] * z[k];
            r[k] = f->load[2][2] * w[k];
        }
        for (int i = 0; i < m; i++) {
            const double c0 = f->mix[0][i], c1 = f->mix[1][i], c2 = f->mix[2][i];
            EACH x[2 * i + k] = decay * (x[2 * i + k] - (c0 * p[k] + c1 * q[k] + c2 * r[k]));
        }
        EACH ROW(u, a)[k] *= decay;
    }
    for (int i = 0; i <= m; i++) {
        v4 *one = i < m ? ROW(A, m + i) : ROW(u, 1), *two = i < m ? ROW(A, 2 * m + i) : ROW(u, 2);
        EACH {
            v4 x = one[k], z = two[k];
            one[k] = f11 * x + f12 * z;
            two[k] = f22 * z + f21 * x;
        }
    }
}

/* Time step (unless step is 0), then what the observation says of the common state. */
static void NAME(arrow_sense)(arrow *f, int step)
{
    const int m = f->m, n = f->n, styles = m - 2;
    v4 *sums = (v4 *)f->sums;
    v4 h[8], worst = {};
    NAME(spread_weights)(&f->at, h);
    memset(sums, 0, (TRI(m, 0) + m + 1) * sizeof(v4));
    f->logs = 0;
    for (int block = 0; block < f->blocks; block++) {
        double *A = f->states + (long)block * f->rows * LANES, *V = A + LANES * n * m, *u = V + LANES * TRI(n, 0);
        v4 *g = ROW(u, n), *vs = ROW(u, n + m), *inverse = ROW(u, n + m + n), *error = inverse + 2;
        const double *constants = (double *)(error + 2);
        const int left = f->channels - block * LANES;
        v4 row[2], slope[2], total[2], seen[2], clean[2];
        if (f->blank)
            NAME(arrow_blank)(f, A, V, constants);
        if (step)
            NAME(arrow_step)(f, A, V, u, constants);
        {   /* the expected observation and its derivatives */
            for (int k = 0; k < 2; k++) {
                const cell *here = f->at.here + 2 * LANES * (styles + 1) * block + LANES / 2 * k;
                const cell *next = f->at.next + 2 * LANES * (styles + 1) * block + LANES / 2 * k;
                v4 p = VALUE(here, 0), q = SLOPE(here, 0), r = VALUE(next, 0), s = SLOPE(next, 0);
                v4 mean = (h[0] * p + h[1] * q) + (h[2] * r + h[3] * s);
                for (int j = 1; j <= styles; j++) {
                    const v4 p0 = VALUE(here, j), q0 = SLOPE(here, j), r0 = VALUE(next, j), s0 = SLOPE(next, j);
                    const v4 value = (h[0] * p0 + h[1] * q0) + (h[2] * r0 + h[3] * s0);
                    const double w = f->w[j];
                    mean += w * value;
                    p += w * p0;
                    q += w * q0;
                    r += w * r0;
                    s += w * s0;
                    g[2 * (1 + j) + k] = value;
                }
                row[k] = mean;
                slope[k] = (h[4] * p + h[5] * q) + (h[6] * r + h[7] * s);
            }
            EACH row[k] += ROW(u, 0)[k] + ROW(u, 1)[k];
            for (int j = 0; j < f->harmonics; j++) {
                const v4 *x = ROW(u, 3 + 2 * j), *z = ROW(u, 4 + 2 * j);
                const double c = f->s[3 + 2 * j], d = f->s[4 + 2 * j];
                EACH {
                    slope[k] += (j + 1) * (c * z[k] - d * x[k]);
                    row[k] += c * x[k] + d * z[k];
                }
            }
        }
        EACH {
            g[k] = slope[k];
            g[2 + k] = (v4){};
        }
        for (int i = 0; i < m; i++) {  /* (the velocity of the fast residual is not seen: s[2] = 0) */
            v4 t[2];
            EACH t[k] = g[2 * i + k] + (ROW(A, i)[k] + ROW(A, m + i)[k]);
            for (int a = 3; a < n; a++)
                EACH t[k] += f->s[a] * ROW(A, a * m + i)[k];
            EACH g[2 * i + k] = t[k];
        }
        EACH total[k] = f->thin * CROW(constants, 0)[k];
        for (int a = 0; a < n; a++) {
            v4 t[2];
            EACH t[k] = ROW(V, TRI(a, 0))[k] + ROW(V, a ? TRI(a, 1) : TRI(1, 0))[k];
            for (int b = 3; b < n; b++)
                EACH t[k] += f->s[b] * ROW(V, a > b ? TRI(a, b) : TRI(b, a))[k];
            EACH vs[2 * a + k] = t[k];
            if (a != 2)
                EACH total[k] += f->s[a] * t[k];
        }
        if (!NAME(take)(f->y + block * LANES, f->observed + block * LANES, left, clean, seen)) {
            EACH inverse[k] = error[k] = (v4){};
            continue;
        }
        EACH {
            inverse[k] = seen[k] / total[k];
            error[k] = seen[k] * (clean[k] - row[k]);
            total[k] = seen[k] * total[k] + (1.0 - seen[k]);
        }
        f->logs += NAME(log_product)(total);
        for (int i = 0; i < m; i++) {
            v4 t[2];
            EACH t[k] = g[2 * i + k] * inverse[k];
            for (int j = 0; j <= i; j++)
                sums[TRI(i, j)] += t[0] * g[2 * j] + t[1] * g[2 * j + 1];
            sums[TRI(m, 0) + i] += t[0] * error[0] + t[1] * error[1];
        }
        EACH {
            const v4 square = error[k] * error[k] * inverse[k];
            const l4 larger = square > worst;
            worst = (v4)(((l4)square & larger) | ((l4)worst & ~larger));
            sums[TRI(m, 0) + m] += square;
        }
    }
    f->worst = fmax(fmax(worst[0], worst[1]), fmax(worst[2], worst[3]));
    f->blank = 0;
}

/* Residual states given the new common state. */
static void NAME(arrow_settle)(arrow *f)
{
    const int m = f->m, n = f->n;
    for (int block = 0; block < f->blocks; block++) {
        double *A = f->states + (long)block * f->rows * LANES, *V = A + LANES * n * m, *u = V + LANES * TRI(n, 0);
        const v4 *g = ROW(u, n), *vs = ROW(u, n + m), *inverse = ROW(u, n + m + n);
        v4 error[2];
        EACH error[k] = inverse[2 + k];
        for (int i = 0; i < m; i++)
            EACH error[k] -= f->delta[i] * g[2 * i + k];
        for (int a = 0; a < n; a++) {
            v4 gain[2], t[2];
            EACH {
                gain[k] = vs[2 * a + k] * inverse[k];
                t[k] = ROW(u, a)[k] + gain[k] * error[k];
            }
            for (int i = 0; i < m; i++)
                EACH {
                    v4 x = ROW(A, a * m + i)[k];
                    t[k] += f->delta[i] * x;
                    ROW(A, a * m + i)[k] = x - gain[k] * g[2 * i + k];
                }
            EACH ROW(u, a)[k] = t[k];
            for (int b = 0; b <= a; b++)
                EACH ROW(V, TRI(a, b))[k] -= gain[k] * vs[2 * b + k];
        }
    }
}

/* Mean and velocity at a time ahead, each (D,) or NULL; where rows is not NULL, the derivative by phase and the bases
   of z, (blocks, 1 + J, 8), for the spread. */
static void NAME(arrow_mean)(const arrow *f, const horizon *x, double *mean, double *velocity, double *rows)
{
    const int m = f->m, n = f->n, styles = m - 2;
    v4 h[8];
    NAME(spread_weights)(&x->at, h);
    for (int half = 0; half < 2 * f->blocks; half++) {
        const int block = half / 2, lane = LANES / 2 * (half % 2), left = f->channels - LANES / 2 * half;
        const double *u = f->states + (long)block * f->rows * LANES + LANES * (n * m + TRI(n, 0)) + lane;
        const cell *here = x->at.here + 2 * LANES * (1 + styles) * block + lane;
        const cell *next = x->at.next + 2 * LANES * (1 + styles) * block + lane;
        v4 *bases = rows ? (v4 *)rows + (1 + styles) * half : NULL;
        v4 p = VALUE(here, 0), q = SLOPE(here, 0), r = VALUE(next, 0), s = SLOPE(next, 0);
        const v4 base = (h[0] * p + h[1] * q) + (h[2] * r + h[3] * s);
        if (bases)
            for (int j = 1; j <= styles; j++)
                bases[j] = (h[0] * VALUE(here, j) + h[1] * SLOPE(here, j))
                    + (h[2] * VALUE(next, j) + h[3] * SLOPE(next, j));
        for (int j = 1; j <= styles; j++) {
            const double w = x->w[j];
            p += w * VALUE(here, j);
            q += w * SLOPE(here, j);
            r += w * VALUE(next, j);
            s += w * SLOPE(next, j);
        }
        v4 row = (h[0] * p + h[1] * q) + (h[2] * r + h[3] * s);
        v4 slope = (h[4] * p + h[5] * q) + (h[6] * r + h[7] * s);
        v4 rate = -x->style_rate * (row - base), personal = {};
        for (int j = 0; j < f->harmonics; j++) {
            const v4 a = CHALF(u, 3 + 2 * j), b = CHALF(u, 4 + 2 * j);
            const double c = x->s[3 + 2 * j], d = x->s[4 + 2 * j];
            slope += (j + 1) * (c * b - d * a);
            personal += c * a + d * b;
        }
        const v4 offset = x->s[0] * CHALF(u, 0), u1 = CHALF(u, 1), u2 = CHALF(u, 2);
        row += (offset + (x->s[1] * u1 + x->s[2] * u2)) + personal;
        rate += (x->speed * slope + (x->f21 * u1 + x->f22 * u2))
            - (x->offset_rate * offset + x->personal_rate * personal);
        NAME(put)(mean + LANES / 2 * half, row, left);
        if (velocity)
            NAME(put)(velocity + LANES / 2 * half, rate, left);
        if (bases)
            bases[0] = slope;
    }
}

/* Standard deviation of a block at H times ahead, 1 or 3: what of the states is loaded serves all of them. */
static inline __attribute__((always_inline)) void NAME(arrow_spread_at)(
    const int H, const arrow *f, const horizon *x, int block, const double *rows, double *const *std)
{
    const int m = f->m, n = f->n, styles = m - 2, left = f->channels - block * LANES;
    const double *A = f->states + (long)block * f->rows * LANES, *V = A + LANES * n * m;
    const double *constants = V + LANES * (TRI(n, 0) + n + m + n + 2);
    v4 g[MOST][3][2], total[3][2];
    for (int h = 0; h < H; h++)
        for (int k = 0; k < 2; k++) {
            const v4 *bases = (const v4 *)(rows + (long)h * (1 + styles) * f->width) + (1 + styles) * (2 * block + k);
            const horizon *at = x + h;
            const v4 slope = bases[0];
            v4 sum = CROW(constants, 0)[k] + at->q_offset * CROW(constants, 1)[k]
                + at->q_fast * CROW(constants, 2)[k] + at->q_personal * CROW(constants, 3)[k]
                + at->wander * slope * slope;
            g[0][h][k] = slope;
            g[1][h][k] = at->ahead * slope;
            for (int j = 0; j < styles; j++) {
                const v4 value = bases[1 + j];
                sum += (1 - at->rho * at->rho) * value * value;
                g[2 + j][h][k] = at->rho * value;
            }
            total[h][k] = sum;
        }
    for (int i = 0; i < m; i++) {
        v4 t[3][2];
        for (int h = 0; h < H; h++)
            EACH t[h][k] = g[i][h][k];
        for (int a = 0; a < n; a++) {
            const v4 *x0 = CROW(A, a * m + i);
            for (int h = 0; h < H; h++)
                EACH t[h][k] += x[h].s[a] * x0[k];
        }
        for (int h = 0; h < H; h++)
            EACH g[i][h][k] = t[h][k];
    }
    for (int i = 0; i < m; i++) {  /* g^T P g with P = C C^T */
        v4 t[3][2];
        for (int h = 0; h < H; h++)
            EACH t[h][k] = f->factor[i * m + i] * g[i][h][k];
        for (int j = i + 1; j < m; j++) {
            const double c = f->factor[j * m + i];
            for (int h = 0; h < H; h++)
                EACH t[h][k] += c * g[j][h][k];
        }
        for (int h = 0; h < H; h++)
            EACH total[h][k] += t[h][k] * t[h][k];
    }
    for (int a = 0; a < n; a++) {
        v4 t[3][2];
        for (int h = 0; h < H; h++)
            EACH t[h][k] = (v4){};
        for (int b = 0; b < a; b++) {
            const v4 *x0 = CROW(V, TRI(a, b));
            for (int h = 0; h < H; h++)
                EACH t[h][k] += x[h].s[b] * x0[k];
        }
        for (int h = 0; h < H; h++)
            EACH total[h][k] += x[h].s[a] * (2 * t[h][k] + x[h].s[a] * CROW(V, TRI(a, a))[k]);
    }
    for (int h = 0; h < H; h++)
        EACH NAME(put)(std[h] + block * LANES + LANES / 2 * k, NAME(root)(total[h][k]), left - LANES / 2 * k);
}

/* Standard deviation at some of the times ahead: std[k] (D,) belongs to x[k] and the rows arrow_mean left there. */
static void NAME(arrow_spread)(const arrow *f, const horizon *x, int count, const double *rows, double *const *std)
{
    const long size = (long)(f->m - 1) * f->width;
    for (int block = 0; block < f->blocks; block++) {
        int h = 0;
        for (; h + 3 <= count; h += 3)
            NAME(arrow_spread_at)(3, f, x + h, block, rows + h * size, std + h);
        for (; h < count; h++)
            NAME(arrow_spread_at)(1, f, x + h, block, rows + h * size, std + h);
    }
}

/* Sums of the EKF over phase and velocity. */
static void NAME(paper_sense)(paper *f, const cubic *at, double extra, const double *y, const unsigned char *observed)
{
    v4 information = {}, score = {}, squares = {}, h[8];
    f->logs = 0;
    NAME(spread_weights)(at, h);
    for (int block = 0; block < f->blocks; block++) {
        v4 total[2], *seen = ROW(f->seen, block), *clean = ROW(f->clean, block);
        if (!NAME(take)(y + block * LANES, observed + block * LANES, f->channels - block * LANES, clean, seen))
            continue;
        for (int k = 0; k < 2; k++) {
            const cell *here = at->here + 2 * LANES * f->count * block + LANES / 2 * k;
            const cell *next = at->next + 2 * LANES * f->count * block + LANES / 2 * k;
            v4 p = {}, q = {}, r = {}, s = {};
            for (int j = 0; j < f->count; j++) {
                const double w = f->w[j];
                p += w * VALUE(here, j);
                q += w * SLOPE(here, j);
                r += w * VALUE(next, j);
                s += w * SLOPE(next, j);
            }
            const v4 mean = (h[0] * p + h[1] * q) + (h[2] * r + h[3] * s);
            const v4 slope = (h[4] * p + h[5] * q) + (h[6] * r + h[7] * s);
            const v4 variance = CROW(f->noise, block)[k] + extra, error = clean[k] - mean;
            const v4 inverse = seen[k] / variance;
            information += slope * slope * inverse;
            score += slope * error * inverse;
            squares += error * error * inverse;
            total[k] = seen[k] * variance + (1.0 - seen[k]);
        }
        f->logs += NAME(log_product)(total);
    }
    f->information = (information[0] + information[1]) + (information[2] + information[3]);
    f->score = (score[0] + score[1]) + (score[2] + score[3]);
    f->squares = (squares[0] + squares[1]) + (squares[2] + squares[3]);
}

/* Sums of the M-step: normal equations and the same weighted by R, each J (J + 1) / 2, then the moments, J. */
static void NAME(paper_learn)(paper *f, const cubic *at)
{
    const int J = f->count, half = TRI(J, 0);
    v4 *sums = (v4 *)f->sums, h[8];
    NAME(spread_weights)(at, h);
    memset(sums, 0, (2 * half + J) * sizeof(v4));
    for (int block = 0; block < f->blocks; block++) {
        const v4 *seen = CROW(f->seen, block), *clean = CROW(f->clean, block), *noise = CROW(f->noise, block);
        const cell *here = at->here + 2 * LANES * J * block, *next = at->next + 2 * LANES * J * block;
        v4 value[MOST][2];
        for (int i = 0; i < J; i++) {
            v4 t[2], z[2];
            EACH {
                const int lane = LANES / 2 * k;
                value[i][k] = (h[0] * VALUE(here + lane, i) + h[1] * SLOPE(here + lane, i))
                    + (h[2] * VALUE(next + lane, i) + h[3] * SLOPE(next + lane, i));
                t[k] = seen[k] * value[i][k];
                z[k] = t[k] * noise[k];
            }
            for (int j = 0; j <= i; j++) {
                sums[TRI(i, j)] += t[0] * value[j][0] + t[1] * value[j][1];
                sums[half + TRI(i, j)] += z[0] * value[j][0] + z[1] * value[j][1];
            }
            sums[2 * half + i] += t[0] * clean[0] + t[1] * clean[1];
        }
    }
}

/* Mean, standard deviation and, unless NULL, velocity at a time ahead, each (D,). */
static void NAME(paper_ahead)(const paper *f, const cubic *at, double extra, double phase_variance, double speed,
                              double *mean, double *std, double *velocity)
{
    const int J = f->count;
    v4 h[8];
    NAME(spread_weights)(at, h);
    for (int half = 0; half < 2 * f->blocks; half++) {
        const int block = half / 2, lane = LANES / 2 * (half % 2), left = f->channels - LANES / 2 * half;
        const cell *here = at->here + 2 * LANES * J * block + lane, *next = at->next + 2 * LANES * J * block + lane;
        v4 value[MOST], total = *((const v4 *)f->noise + half) + extra, p = {}, q = {}, r = {}, s = {};
        for (int j = 0; j < J; j++) {
            const v4 p0 = VALUE(here, j), q0 = SLOPE(here, j), r0 = VALUE(next, j), s0 = SLOPE(next, j);
            const double w = f->w[j];
            value[j] = (h[0] * p0 + h[1] * q0) + (h[2] * r0 + h[3] * s0);
            p += w * p0;
            q += w * q0;
            r += w * r0;
            s += w * s0;
        }
        const v4 slope = (h[4] * p + h[5] * q) + (h[6] * r + h[7] * s);
        total += phase_variance * slope * slope;
        for (int i = 0; i < J; i++) {
            v4 t = f->spread[i * J] * value[0];
            for (int j = 1; j <= i; j++)
                t += f->spread[i * J + j] * value[j];
            total += t * value[i];
        }
        NAME(put)(mean + LANES / 2 * half, (h[0] * p + h[1] * q) + (h[2] * r + h[3] * s), left);
        NAME(put)(std + LANES / 2 * half, NAME(root)(total), left);
        if (velocity)
            NAME(put)(velocity + LANES / 2 * half, speed * slope, left);
    }
}

/* x where it is less than most, else that */
static inline f8 NAME(least)(f8 x, float most)
{
    const f8 y = {most, most, most, most, most, most, most, most};
    const i8 less = x < y;
    return (f8)(((i8)x & less) | ((i8)y & ~less));
}

/* Minus twice the log likelihood of the last samples, but for a constant, at each of some phases: node (count, samples)
   is where the samples lie. What belongs to a block is loaded once for all phases. */
static void NAME(glance_scores)(glance *f, int count, const int *node, double *scores)
{
    const int samples = f->samples;
    const float most = f->most;
    f8 *totals = (f8 *)f->totals;
    memset(totals, 0, count * sizeof(f8));
    for (int block = 0; block < f->blocks; block++) {
        const f8 *y = (const f8 *)f->y + (long)block * samples, *seen = (const f8 *)f->seen + (long)block * samples;
        const f8 *mean = (const f8 *)f->mean + (long)block * f->nodes;
        const f8 *posture = (const f8 *)f->posture + (long)block * count;
        const f8 *log_posture = (const f8 *)f->log_posture + (long)block * count;
        const f8 change = ((const f8 *)f->change)[block], any = ((const f8 *)f->any)[block];
        const f8 over = ((const f8 *)f->over)[block];
        for (int p = 0; p < count; p++) {
            const int *at = node + (long)p * samples;
            f8 first = {}, second = {};
            for (int i = 0; i < samples; i++) {
                const f8 error = seen[i] * (y[i] - mean[at[i]]);
                first += error;
                second += error * error;
            }
            const f8 average = first * over;
            totals[p] += NAME(least)(average * average * posture[p], most) + any * log_posture[p]
                + NAME(least)((second - first * average) * change, most);
        }
    }
    for (int p = 0; p < count; p++) {
        const f8 total = totals[p];
        scores[p] = (double)(((total[0] + total[1]) + (total[2] + total[3]))
                             + ((total[4] + total[5]) + (total[6] + total[7])));
    }
}

#undef EACH
#undef ROW
#undef CROW
#undef HALF
#undef CHALF
#undef VALUE
#undef SLOPE
#undef TRI
