"""The panel beside a prediction: phase as a clock, behaviours as bars, status; HTML without any script."""
from html import escape

import numpy as np

from style_core.predictor import Status

__all__ = ['clock_face']

_STATUS = {Status.ACQUIRING: ('searching', '#0072b2'), Status.TRACKING: ('tracking', '#009e73'),
           Status.LOST: ('lost', '#d55e00'), Status.UNKNOWN: ('unknown motion', '#8a3800')}
_INK, _LINE, _FILL = '#57606a', '#d0d7de', '#d55e00'


def clock_face(overlay, frame, rhythmic=True):
    """HTML of one frame of an `Overlay`.

    Parameters
    ----------
    overlay : Overlay
    frame : int
    rhythmic : bool
        Is the phase an angle (rad) or a share of the way, [0, 1]?

    Returns
    -------
    str
    """
    words, colour = _STATUS[overlay.status[frame]]
    error = overlay.errors()[frame]
    band = float(np.nanmean(overlay.std[frame])) if np.isfinite(overlay.std[frame]).any() else np.nan
    rows = [f'<div style="color:{colour};font-weight:600">{words}</div>',
            f'<div style="display:flex;align-items:center;gap:12px">{_clock(overlay.phase[frame], rhythmic)}'
            f'<div>error {_degrees(error)}<br>band (1 std) {_degrees(band)}<br>'
            f'{overlay.ahead_s * 1e3:.0f} ms ahead</div></div>']
    for name, share in sorted(overlay.behaviours[frame].items(), key=lambda item: -item[1])[:6]:
        rows.append(f'<div style="display:flex;gap:8px"><span style="width:9em;overflow:hidden;white-space:nowrap">'
                    f'{escape(str(name))}</span><span style="flex:1;background:{_LINE};height:10px;margin-top:5px">'
                    f'<span style="display:block;height:10px;background:{_FILL};'
                    f'width:{100 * min(max(share, 0), 1):.0f}%"></span></span></div>')
    return f'<div style="font-size:13px;padding:6px 12px" class="clock-face">{"".join(rows)}</div>'


def _clock(phase, rhythmic):
    if not np.isfinite(phase):
        return '<div>no phase</div>'
    turn = phase if rhythmic else 2 * np.pi * phase
    x, y = 32 + 24 * np.sin(turn), 32 - 24 * np.cos(turn)
    return (f'<svg width="64" height="64" role="img" aria-label="phase {turn / (2 * np.pi):.2f}">'
            f'<circle cx="32" cy="32" r="28" fill="none" stroke="{_LINE}" stroke-width="3"/>'
            f'<line x1="32" y1="32" x2="{x:.1f}" y2="{y:.1f}" stroke="{_FILL}" stroke-width="4"/>'
            f'<circle cx="32" cy="32" r="3" fill="{_INK}"/></svg>')


def _degrees(value):
    return f'{np.degrees(value):.1f}°' if np.isfinite(value) else 'not known'
