/* Loops over all joints; apart from their callers so that the compiler knows that nothing overlaps. */
#include <math.h>

/* sum += weight * row */
static inline void add_row(int n, double weight, const double *restrict row, double *restrict sum)
{
    for (int d = 0; d < n; d++) sum[d] += weight * row[d];
}

/* The combination at one horizon (see forecasts.pyx): mean, std and velocity of the model become the combination's. */
static inline void combine_row(int n, const double *restrict apart_value, const double *restrict apart_slope,
                               double share, double slope, double grown, double usual, double early,
                               double lower, double upper,
                               const double *restrict squares_low, const double *restrict squares_high,
                               const double *restrict frames_low, const double *restrict frames_high,
                               double stretch, double *restrict mean, double *restrict std, double *restrict velocity)
{
    for (int d = 0; d < n; d++) {
        const double apart = mean[d] - apart_value[d];
        const double prior = std[d] * std[d] * grown;
        const double squares = stretch * (lower * squares_low[d] + upper * squares_high[d]) + usual * prior;
        const double frames = lower * frames_low[d] + upper * frames_high[d] + usual;
        mean[d] = apart_value[d] + share * apart;
        velocity[d] = apart_slope[d] + share * (velocity[d] - apart_slope[d]) + slope * apart;
        std[d] = sqrt(early * (squares / frames) + (1 - early) * prior);
    }
}
