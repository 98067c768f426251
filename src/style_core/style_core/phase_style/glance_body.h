/* Included by twice.h once an instruction set. */

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
