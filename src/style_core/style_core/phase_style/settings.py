"""Settings of search, rejection and loss that no rule learns: unit, meaning, and where each was chosen.

Those marked *constants* are halved and doubled one at a time, on the training list alone, by
benchmarks/experiments/prediction_constants.py; what hangs on them stands in
docs/results/prediction/prediction_constants.md. Those marked *faults* were chosen with sensors that lie
(docs/experiments.md, rejection), those marked *speed* are costs measured in use
(benchmarks/speed/bench_phase_style.py). What is learned is in `style_core.phase_style.residual`.
"""

# ---- samples that a search looks at
#: Samples kept for starting a hypothesis in the past, number. *constants*
WINDOW = 10
#: Samples that a glance looks at, number. *constants*
GLANCE = 6
#: Smallest distance of samples, s: a little less than that of the rate the models are trained at.
SPACING_S = 1 / 60.0 - 1e-3

# ---- what a search may cost, in updates of a filter
#: Work spent on one observation at most. *constants*; docs/phase_style.md, speed, on smaller ones
BUDGET = 5.0
#: What a glance costs for each speed, and once more to lay out the samples. *speed*
GLANCE_COST = 0.35
#: What a start costs. *speed*
START_COST = 0.35
#: Hypotheses that run at a time, number. *constants*
LIVE = 3

# ---- where hypotheses start
#: Phases tried of a behaviour at a glance, number. *constants*
PHASES = 32
#: Speeds tried, standard deviations of the training speeds from their mean. *constants*
SPEEDS = (0.0, -1.2, 1.2, 2.4)
#: Samples in the past from which a new hypothesis starts, number. *constants*
REPLAY = 4
#: Best phases kept of a glance, number, and how long they count, s. *constants*
PEAKS = 3
STALE_S = 0.15

# ---- how hypotheses are compared
#: Weight of the past, a sample, in the likelihood of what a hypothesis saw, 1. *constants*
MEMORY = 0.85
#: Successive innovations of one filter repeat each other: so many count as one, number. *constants*
CORRELATED = 5.0
#: Lead at which another hypothesis takes over, and one at which the one behind is given up, nats. *constants*
TAKE_OVER = 1.0
GIVE_UP = 3.0
#: Samples after which a hypothesis that does not lead makes room for a new one, number. *constants*
PATIENCE = 12
#: Samples that a hypothesis must have been judged on to be given up, number; chosen with the first search.
FEWEST_JUDGED = 3

# ---- when a search ends
#: Duration after which the leader is taken if it explains what it sees; otherwise the search goes on, s. *constants*
SEARCH_S = 0.4
#: Duration and samples of the leader after which a clear lead is taken, s and number; chosen with the first search.
SHORTEST_S, SHORTEST_SAMPLES = 0.1, 6
#: Innovation a joint, averaged over what was seen, up to which a leader explains it, 1; one is promised. *constants*
EXPLAINS = 3.0
#: Where every hypothesis is farther off than this on average, the search begins anew, standard deviations. *faults*
ELSEWHERE = 12.0
#: Times in a row that a search may begin anew, number. *constants*
ANEW = 2

# ---- rejection
#: Innovation beyond which a joint is left out, and that it counts as in a likelihood, standard deviations.
#: *constants*, *faults*
LIMIT = 20.0
#: Share of the joints up to which it is the sensors that are wrong, 1; beyond it is the motion. *constants*, *faults*
FEW = 0.15
#: Beside a joint beyond the limit, others are left out from this share of it on, 1: a limb fails as a whole. *faults*
SUSPECT = 0.25
#: Of fewer joints than this no single one can be told to be wrong, number; by definition of a majority.
ALONE = 4
#: A joint that contradicts the filter, but not itself, enters again after this long, s. *faults*
BELIEVED_S = 0.05

# ---- after a loss
#: So long a leader that did not take in what called a loss is kept as it was, s: it leads again once what is seen is
#: as it expects. And so long it goes on speaking: nobody is elsewhere that fast, but what a bus says may be. *faults*
KEPT_S, HOLD_S = 0.25, 0.05
#: After a longer silence what was known about the phase is worth nothing, s: the search starts again. *constants*
GAP_S = 2.0
