/* @title@
 *
 * H at the newest of basset_steps + 1 nodes = sum of basset_weight[j] g[j], the newest sample first.
 * Made by: @command@
 */
#ifndef BASSET_WEIGHTS_H
#define BASSET_WEIGHTS_H

enum { basset_steps = @steps@ };
static const double basset_step = @dt@;
@arrays@
/* H from samples at basset_steps + 1 nodes, the oldest first, as they come */
static inline double basset_history(const double *g)
{
    double value = 0.0;
    for (int j = 0; j <= basset_steps; ++j) value += basset_weight[j] * g[basset_steps - j];
    return value;
}

/* The same for g = 1/(1 + k) at node k, over the value that basset found, less 1 */
static inline double basset_test(void)
{
    double value = 0.0;
    for (int j = 0; j <= basset_steps; ++j) value += basset_weight[j] / (1.0 + basset_steps - j);
    return value / @test_value@ - 1.0;
}
#endif
