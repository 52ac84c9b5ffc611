/* @title@
 *
 * @promise@
 * The history integral H(t) = sum of jumps*K + integral K(t - tau) g(tau) dtau of samples of the rate g = df/dt, every basset_step:
 * @recursion@
 *
 *     basset_history history = {0};
 *     basset_push(&history, g0);                     the first sample, at the first node
 *     basset_jump(&history, f0);                     the initial slip, and later any jump of f at the newest node
 *     double value = basset_push(&history, g1);      H at the next node
 *
 * From node basset_last on H = (what is known before) + basset_newest[0]*g: solve for g where it depends on H.
 * Made by: @command@
 */
#ifndef BASSET_SUM_H
#define BASSET_SUM_H
#include <math.h>

enum { basset_terms = @terms@, basset_last = @last@, basset_window = @window@, basset_steps = @steps@ };
static const double basset_near = @near@, basset_far = @far@, basset_tolerance = @rtol@, basset_step = @dt@;
@arrays@
typedef struct {
    long count;                         /* samples so far */
    double sample[basset_last + 1];     /* newest first */
    double term[basset_terms];          /* one number per exponential */
    double coming[basset_window];       /* what jumps add at the next nodes beyond their exponentials */
} basset_history;                       /* all zero at the start */

/* K(lag) as the sum, basset_near <= lag <= basset_far */
static inline double basset_sum(double lag)
{
    double value = 0.0;
    for (int i = 0; i < basset_terms; ++i) value += basset_weight[i] * exp(-basset_rate[i] * lag);
    return value;
}

/* H at the next node, where the rate is g; NAN more than basset_steps after the first */
static inline double basset_push(basset_history *h, double g)
{
    const long n = h->count++;
    double value = h->coming[0];
    if (n > basset_steps) return NAN;
    for (int j = basset_last; j > 0; --j) h->sample[j] = h->sample[j - 1];
    h->sample[0] = g;
    for (int j = 0; j <= basset_last; ++j) value += (n < basset_last ? basset_start[n][j] : basset_newest[j]) * h->sample[j];
    for (int i = 0; i < basset_terms; ++i) {
        double gained = n > basset_last ? basset_gain[i] * h->sample[basset_last] : 0.0;
        if (n == basset_last) for (int j = 0; j <= basset_last; ++j) gained += basset_entry[i][j] * h->sample[j];
        h->term[i] += gained - basset_loss[i] * h->term[i];
        value += h->term[i];
    }
    for (int k = 0; k < basset_window; ++k) h->coming[k] = k + 1 < basset_window ? h->coming[k + 1] : 0.0;
    return value;
}

/* f jumps by delta at the newest node */
static inline void basset_jump(basset_history *h, double delta)
{
    for (int i = 0; i < basset_terms; ++i) h->term[i] += delta * basset_weight[i];
    for (int k = 0; k < basset_window; ++k) h->coming[k] += delta * basset_excess[k];
}

/* Relative deviation from the value that basset found for g = 1/(1 + k) at node k = 0 ... @test_steps@ and an initial slip of 1 */
static inline double basset_test(void)
{
    basset_history h = {0};
    double value = basset_push(&h, 1.0);
    basset_jump(&h, 1.0);
    for (int k = 1; k <= @test_steps@; ++k) value = basset_push(&h, 1.0 / (1.0 + k));
    return value / @test_value@ - 1.0;
}
#endif
