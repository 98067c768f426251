/* Included by twice.h once an instruction set. */

/* Covariance of a block's states at their priors, independent of the common state: eq. (4). */
static inline void NAME(arrow_blank)(const arrow *f, double *A, double *V, const double *constants)
{
    memset(A, 0, (char *)constants - (char *)A);
    for (int a = 0; a < f->n; a++)
        EACH ROW(V, TRI(a, a))[k] = CROW(constants, 1 + f->part[a])[k];
    for (int p = 0; p < f->couples; p++) {
        const coupled *c = &f->couple[p];
        const v4 *variance = CROW(constants, 1 + f->part[c->first]);
        for (int i = 0; i < c->size; i++)
            for (int j = 0; j <= i; j++)
                EACH ROW(V, TRI(c->first + i, c->first + j))[k] = c->prior[TRI(i, j)] * variance[k];
    }
}

/* The same of all blocks. */
static void NAME(arrow_fill)(arrow *f)
{
    for (int block = 0; block < f->blocks; block++) {
        double *A = f->states + (long)block * f->rows * LANES;
        NAME(arrow_blank)(f, A, A + LANES * arrow_v(f), A + LANES * arrow_constants(f));
    }
    f->blank = 0;
}

/* Rows x <- g x; size is known when this is compiled into its caller. */
static inline __attribute__((always_inline)) void NAME(turn)(const int size, const double *g, v4 *const *x)
{
    EACH {
        v4 before[WIDEST];
        for (int i = 0; i < size; i++)
            before[i] = x[i][k];
        for (int i = 0; i < size; i++) {
            v4 t = g[i * size] * before[0];
            for (int j = 1; j < size; j++)
                t += g[i * size + j] * before[j];
            x[i][k] = t;
        }
    }
}

/* Coupled states in V <- G V G^T + Q_d, eq. (9): G from the left to what they share with others, from both sides to
   their own covariance. */
static inline __attribute__((always_inline)) void NAME(step_covariance)(
    const int size, const coupled *c, int n, double *V, const v4 *variance)
{
    const int first = c->first;
    const double *g = c->g;
    v4 *x[WIDEST];
    for (int b = 0; b < n; b++) {
        if (b == first)
            b += size;
        if (b >= n)
            break;
        for (int i = 0; i < size; i++)
            x[i] = ROW(V, b < first ? TRI(first + i, b) : TRI(b, first + i));
        NAME(turn)(size, g, x);
    }
    EACH {
        v4 own[WIDEST][WIDEST], half[WIDEST][WIDEST];
        for (int i = 0; i < size; i++)
            for (int j = 0; j <= i; j++)
                own[i][j] = own[j][i] = ROW(V, TRI(first + i, first + j))[k];
        for (int i = 0; i < size; i++)
            for (int j = 0; j < size; j++) {
                half[i][j] = g[i * size] * own[0][j];
                for (int l = 1; l < size; l++)
                    half[i][j] += g[i * size + l] * own[l][j];
            }
        for (int i = 0; i < size; i++)
            for (int j = 0; j <= i; j++) {
                v4 total = c->fresh[TRI(i, j)] * variance[k];
                for (int l = 0; l < size; l++)
                    total += half[i][l] * g[j * size + l];
                ROW(V, TRI(first + i, first + j))[k] = total;
            }
    }
}

/* Coupled states in A <- G A M and u <- G u, eqs. (8) and (10). */
static inline __attribute__((always_inline)) void NAME(step_means)(
    const int size, const coupled *c, int m, double *A, double *u)
{
    v4 *x[WIDEST];
    for (int i = 0; i <= m; i++) {
        for (int j = 0; j < size; j++)
            x[j] = i < m ? ROW(A, (c->first + j) * m + i) : ROW(u, c->first + j);
        NAME(turn)(size, c->g, x);
    }
}

/* Time step of a block, eqs. (8) to (10): V <- G (V + A N A^T) G^T + Q_d, A <- G A M, u <- G u. */
static inline void NAME(arrow_step)(const arrow *f, double *A, double *V, double *u, const double *constants)
{
    const int m = f->m, n = f->n, third = f->third;
    const double over = 1 / f->rho;
    v4 L[MOST][3][2];  /* A B, where N = B B^T: eq. (7) */
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
    for (int p = 0; p < f->couples; p++) {
        const coupled *c = &f->couple[p];
        const v4 *variance = CROW(constants, 1 + f->part[c->first]);
        if (c->size == 2)
            NAME(step_covariance)(2, c, n, V, variance);
        else
            NAME(step_covariance)(3, c, n, V, variance);
    }
    for (int a = 0; a < n; a++)
        EACH ROW(V, TRI(a, a))[k] += f->renewal[a] * CROW(constants, 1 + f->part[a])[k];
    for (int a = 0; a < n; a++) {  /* A F^-1 (I - Qs Qs^T P^-1): eq. (6) */
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
    for (int p = 0; p < f->couples; p++) {
        const coupled *c = &f->couple[p];
        if (c->size == 2)
            NAME(step_means)(2, c, m, A, u);
        else
            NAME(step_means)(3, c, m, A, u);
    }
}

/* The expected observation of a block and its derivatives by the common state, g = h + A^T s, eqs. (2) and (11). */
static inline void NAME(arrow_expect)(const arrow *f, const v4 *h, int block, const double *A, const double *u,
                                      v4 *g, v4 *row)
{
    const int m = f->m, n = f->n, styles = m - 2;
    EACH {
        const cell *here = f->at.here + 2 * LANES * (styles + 1) * block + LANES / 2 * k;
        const cell *next = f->at.next + 2 * LANES * (styles + 1) * block + LANES / 2 * k;
        v4 p = VALUE(here, 0), q = SLOPE(here, 0), r = VALUE(next, 0), s = SLOPE(next, 0);
        v4 mean = CUBIC(h, p, q, r, s), states = {}, turning = {};
        for (int j = 1; j <= styles; j++) {
            const v4 p0 = VALUE(here, j), q0 = SLOPE(here, j), r0 = VALUE(next, j), s0 = SLOPE(next, j);
            const v4 value = CUBIC(h, p0, q0, r0, s0);
            const double w = f->w[j];
            mean += w * value;
            p += w * p0;
            q += w * q0;
            r += w * r0;
            s += w * s0;
            g[2 * (1 + j) + k] = value;
        }
        for (int a = 0; a < n; a++) {
            states += f->s[a] * CROW(u, a)[k];
            turning += f->by_phase[a] * CROW(u, a)[k];
        }
        row[k] = mean + states;
        g[k] = CUBIC(h + 4, p, q, r, s) + turning;
        g[2 + k] = (v4){};
    }
    for (int i = 0; i < m; i++) {
        v4 t[2];
        EACH t[k] = g[2 * i + k];
        for (int a = 0; a < n; a++)
            EACH t[k] += f->s[a] * CROW(A, a * m + i)[k];
        EACH g[2 * i + k] = t[k];
    }
}

/* V s of a block, and the variance of what is observed given the common state, S = s^T V s + R: eq. (11). */
static inline void NAME(arrow_variances)(const arrow *f, const double *V, const double *constants, v4 *vs, v4 *total)
{
    const int n = f->n;
    EACH total[k] = f->thin * CROW(constants, 0)[k];
    for (int a = 0; a < n; a++) {
        v4 t[2];
        EACH t[k] = (v4){};
        for (int b = 0; b <= a; b++)
            EACH t[k] += f->s[b] * CROW(V, TRI(a, b))[k];
        for (int b = a + 1; b < n; b++)
            EACH t[k] += f->s[b] * CROW(V, TRI(b, a))[k];
        EACH vs[2 * a + k] = t[k];
        EACH total[k] += f->s[a] * t[k];
    }
}

/* Time step (unless step is 0), then what the observation says of the common state: the sums of eq. (12). */
static void NAME(arrow_innovate)(arrow *f, int step)
{
    const int m = f->m;
    v4 *sums = (v4 *)f->sums;
    v4 h[8], worst = {};
    NAME(spread_weights)(&f->at, h);
    memset(sums, 0, (TRI(m, 0) + m + 1) * sizeof(v4));
    f->logs = 0;
    for (int block = 0; block < f->blocks; block++) {
        double *A = f->states + (long)block * f->rows * LANES, *V = A + LANES * arrow_v(f), *u = A + LANES * arrow_u(f);
        v4 *g = ROW(A, arrow_g(f)), *inverse = ROW(A, arrow_inverse(f)), *error = ROW(A, arrow_error(f));
        const double *constants = A + LANES * arrow_constants(f);
        const int left = f->channels - block * LANES;
        v4 row[2], total[2], seen[2], clean[2];
        if (f->blank)
            NAME(arrow_blank)(f, A, V, constants);
        if (step)
            NAME(arrow_step)(f, A, V, u, constants);
        NAME(arrow_expect)(f, h, block, A, u, g, row);
        NAME(arrow_variances)(f, V, constants, ROW(A, arrow_vs(f)), total);
        if (!NAME(observed_of)(f->y + block * LANES, f->observed + block * LANES, left, clean, seen)) {
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

/* Residual states given the new common state: eq. (13). */
static void NAME(arrow_correct)(arrow *f)
{
    const int m = f->m, n = f->n;
    for (int block = 0; block < f->blocks; block++) {
        double *A = f->states + (long)block * f->rows * LANES, *V = A + LANES * arrow_v(f), *u = A + LANES * arrow_u(f);
        const v4 *g = ROW(A, arrow_g(f)), *vs = ROW(A, arrow_vs(f)), *inverse = ROW(A, arrow_inverse(f));
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
   of z, (2 blocks, 1 + J, 4), for the spread: eq. (14). */
static void NAME(arrow_mean)(const arrow *f, const horizon *x, double *mean, double *velocity, double *rows)
{
    const int n = f->n, styles = f->m - 2;
    v4 h[8];
    NAME(spread_weights)(&x->at, h);
    for (int block = 0; block < f->blocks; block++) {
        const double *u = f->states + ((long)block * f->rows + arrow_u(f)) * LANES;
        const cell *here = x->at.here + 2 * LANES * (1 + styles) * block;
        const cell *next = x->at.next + 2 * LANES * (1 + styles) * block;
        v4 states[2] = {}, moving[2] = {}, turning[2] = {};
        for (int a = 0; a < n; a++)
            EACH {
                states[k] += x->s[a] * CROW(u, a)[k];
                moving[k] += x->by_time[a] * CROW(u, a)[k];
            }
        if (rows)
            for (int a = 0; a < n; a++)
                EACH turning[k] += x->by_phase[a] * CROW(u, a)[k];
        EACH {
            const int lane = LANES / 2 * k, left = f->channels - block * LANES - lane;
            v4 b[4] = {VALUE(here + lane, 0), SLOPE(here + lane, 0), VALUE(next + lane, 0), SLOPE(next + lane, 0)};
            const v4 base = CUBIC(h, b[0], b[1], b[2], b[3]);
            for (int j = 1; j <= styles; j++)
                NAME(add_basis)(b, x->w[j], here + lane, next + lane, j);
            const v4 row = CUBIC(h, b[0], b[1], b[2], b[3]);
            const v4 slope = CUBIC(h + 4, b[0], b[1], b[2], b[3]);
            NAME(put)(mean + block * LANES + lane, row + states[k], left);
            if (velocity)
                NAME(put)(velocity + block * LANES + lane,
                          (x->speed * slope - x->style_rate * (row - base)) + moving[k], left);
            if (rows) {
                v4 *bases = (v4 *)rows + (1 + styles) * (2 * block + k);
                for (int j = 1; j <= styles; j++)
                    bases[j] = NAME(basis)(h, here + lane, next + lane, j);
                bases[0] = slope + turning[k];
            }
        }
    }
}

/* Standard deviation of a block, eq. (15), at H times ahead, 1 or 3: states are loaded once for all of them. */
static inline __attribute__((always_inline)) void NAME(arrow_spread_at)(
    const int H, const arrow *f, const horizon *x, int block, const double *rows, double *const *std)
{
    const int m = f->m, n = f->n, styles = m - 2, left = f->channels - block * LANES;
    const double *A = f->states + (long)block * f->rows * LANES, *V = A + LANES * arrow_v(f);
    const double *constants = A + LANES * arrow_constants(f);
    v4 g[MOST][3][2], total[3][2];
    for (int h = 0; h < H; h++)
        for (int k = 0; k < 2; k++) {
            const v4 *bases = (const v4 *)(rows + (long)h * (1 + styles) * f->width) + (1 + styles) * (2 * block + k);
            const horizon *at = x + h;
            const v4 slope = bases[0];
            v4 sum = CROW(constants, 0)[k] + at->wander * slope * slope;
            g[0][h][k] = slope;
            g[1][h][k] = at->ahead * slope;
            for (int j = 0; j < styles; j++) {
                const v4 value = bases[1 + j];
                sum += (1 - at->rho * at->rho) * value * value;
                g[2 + j][h][k] = at->rho * value;
            }
            total[h][k] = sum;
        }
    for (int p = 0; p < f->parts; p++)
        for (int h = 0; h < H; h++)
            EACH total[h][k] += x[h].fresh[p] * CROW(constants, 1 + p)[k];
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
