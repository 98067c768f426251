"""How synthesis is doing, as /diagnostics show it."""
from style_core.stream.health import OK, WARN, Health

__all__ = ['synthesis_health']

#: joints named in one report
_MOST_NAMED = 4
#: staying behind by less than this is told, but nothing to worry about, rad
WORRY = 0.1


def synthesis_health(stage, tally):
    """Health since the last report.

    Parameters
    ----------
    stage : Stage
    tally : style_core.stream.tally.Tally
        With times of ``window``, and counts of ``windows``, ``missed deadlines``, and what was refused.

    Returns
    -------
    Health
    """
    standing, counts, fresh = stage.standing(), tally.total, tally.fresh()
    median, high = tally.percentiles('window')
    behind = stage.take_saturation()
    facts = {'mode': stage.mode, 'state': str(standing.state), 'message': standing.message or 'none',
             'windows in the last report': str(fresh['windows']),
             'window time p50, p99 (ms)': f'{1e3 * median:.3f}, {1e3 * high:.3f}',
             'saturated joints (rad behind what was asked for)': ', '.join(
                 f'{joint} {gap:.3f}' for joint, gap in behind.items() if gap > 1e-3) or 'none',
             **{name: str(counts[name]) for name in sorted(counts)}}
    trouble = [f'{count} {name}' for name, count in fresh.items() if 'refused' in name and count]
    if fresh['missed deadlines']:
        trouble.append(f'{fresh["missed deadlines"]} deadlines missed')
    far = [f'{joint} by {gap:.2f} rad' for joint, gap in behind.items() if gap > WORRY]
    if far:
        more = f' and {len(far) - _MOST_NAMED} more' if len(far) > _MOST_NAMED else ''
        trouble.append(f'more is asked for than motors can do: behind are {", ".join(far[:_MOST_NAMED])}{more}')
    if 'estimates' in standing.message:
        trouble.append(standing.message)
    return Health(WARN if trouble else OK, ', '.join(trouble) or standing.message or 'performing', facts)
