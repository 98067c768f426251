/* Included by twice.h once an instruction set. */

/* Innovation of the EKF over phase and velocity (A.4): H^T R^-1 H, H^T R^-1 e, e^T R^-1 e and log det R. */
static void NAME(matsubara_innovate)(matsubara *f, const cubic *at, double extra, const double *y,
                                     const unsigned char *observed)
{
    v4 information = {}, score = {}, squares = {}, h[8];
    f->logs = 0;
    NAME(spread_weights)(at, h);
    for (int block = 0; block < f->blocks; block++) {
        v4 total[2], *seen = ROW(f->seen, block), *clean = ROW(f->clean, block);
        if (!NAME(observed_of)(y + block * LANES, observed + block * LANES, f->channels - block * LANES, clean, seen))
            continue;
        for (int k = 0; k < 2; k++) {
            const cell *here = at->here + 2 * LANES * f->count * block + LANES / 2 * k;
            const cell *next = at->next + 2 * LANES * f->count * block + LANES / 2 * k;
            v4 x[4] = {};
            for (int j = 0; j < f->count; j++)
                NAME(add_basis)(x, f->w[j], here, next, j);
            const v4 slope = CUBIC(h + 4, x[0], x[1], x[2], x[3]);
            const v4 variance = CROW(f->noise, block)[k] + extra;
            const v4 error = clean[k] - CUBIC(h, x[0], x[1], x[2], x[3]);
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

/* Sums of the M-step: mu^T mu of (A.11) and mu^T R mu, each J (J + 1) / 2, then mu^T y of (A.12), J. */
static void NAME(matsubara_maximise)(matsubara *f, const cubic *at)
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
                value[i][k] = NAME(basis)(h, here + LANES / 2 * k, next + LANES / 2 * k, i);
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

/* Mean, standard deviation and, unless NULL, velocity at a time ahead, each (D,): section 3.3. */
static void NAME(matsubara_forecast)(const matsubara *f, const cubic *at, double extra, double phase_variance,
                                     double speed, double *mean, double *std, double *velocity)
{
    const int J = f->count;
    v4 h[8];
    NAME(spread_weights)(at, h);
    for (int half = 0; half < 2 * f->blocks; half++) {
        const int block = half / 2, lane = LANES / 2 * (half % 2), left = f->channels - LANES / 2 * half;
        const cell *here = at->here + 2 * LANES * J * block + lane, *next = at->next + 2 * LANES * J * block + lane;
        v4 value[MOST], total = *((const v4 *)f->noise + half) + extra, x[4] = {};
        for (int j = 0; j < J; j++) {
            value[j] = NAME(basis)(h, here, next, j);
            NAME(add_basis)(x, f->w[j], here, next, j);
        }
        const v4 slope = CUBIC(h + 4, x[0], x[1], x[2], x[3]);
        total += phase_variance * slope * slope;
        for (int i = 0; i < J; i++) {
            v4 t = f->spread[i * J] * value[0];
            for (int j = 1; j <= i; j++)
                t += f->spread[i * J + j] * value[j];
            total += t * value[i];
        }
        NAME(put)(mean + LANES / 2 * half, CUBIC(h, x[0], x[1], x[2], x[3]), left);
        NAME(put)(std + LANES / 2 * half, NAME(root)(total), left);
        if (velocity)
            NAME(put)(velocity + LANES / 2 * half, speed * slope, left);
    }
}
