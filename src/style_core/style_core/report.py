"""Result pages: every table and picture of an experiment with what produced it."""
import hashlib
import json
import platform
from pathlib import Path

import numpy as np
import scipy

from style_core import __version__

__all__ = ['Report']


class Report:
    """Collect tables and figures, then write ``NAME.md``, ``NAME.json`` and the pictures beside them.

    Parameters
    ----------
    name : str
        File stem, e.g. ``'prediction_seed_protocol'``.
    title : str
    command : str
        What a reader runs to get the same page.
    seed : int, optional
    data : iterable of path-like, optional
        Files read; names and one hash over all contents are recorded, never the folders.
    """

    def __init__(self, name, title, command, seed=None, data=()):
        self.name = name
        self._parts = []
        digest = hashlib.sha256()
        # files of the same name in several folders go by what they hold
        files = sorted(((path.name, path.read_bytes()) for path in {Path(path) for path in data}),
                       key=lambda file: (file[0], hashlib.sha256(file[1]).digest()))
        for file, content in files:
            digest.update(file.encode())
            digest.update(content)
        self._record = {
            'title': title, 'command': command, 'seed': seed,
            'versions': {'style_core': __version__, 'python': platform.python_version(),
                         'numpy': np.__version__, 'scipy': scipy.__version__},
            'data': {'files': [file for file, _ in files],
                     'sha256': digest.hexdigest() if files else None},
            'tables': {}}
        self._figures = []

    def text(self, paragraph):
        """Add a paragraph of Markdown."""
        self._parts.append(paragraph)

    def table(self, name, columns, rows, caption=''):
        """Add a table; floats are shown with four significant figures, kept exactly in the JSON file."""
        rows = [list(row) for row in rows]
        self._record['tables'][name] = {'columns': list(columns), 'rows': rows}
        lines = [f'**{caption or name}**', '', '| ' + ' | '.join(map(str, columns)) + ' |',
                 '|' + ' --- |' * len(columns)]
        lines += ['| ' + ' | '.join(_shown(cell) for cell in row) + ' |' for row in rows]
        self._parts.append('\n'.join(lines))

    def figure(self, figure, name, caption=''):
        """Add a matplotlib figure, written as ``NAME_<name>.png``."""
        self._figures.append((figure, f'{self.name}_{name}.png'))
        self._parts.append(f'![{caption or name}]({self.name}_{name}.png)\n\n{caption}')

    def write(self, folder):
        """Write everything into ``folder``; returns the path of the Markdown page."""
        import matplotlib.pyplot as plt
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        for figure, file_name in self._figures:
            figure.savefig(folder / file_name, dpi=110, bbox_inches='tight')
            plt.close(figure)
        record = self._record
        versions = ', '.join(f'{key} {value}' for key, value in record['versions'].items())
        data = f"{len(record['data']['files'])} files, SHA-256 {record['data']['sha256'][:16]}" \
            if record['data']['sha256'] else 'none'
        head = [f"# {record['title']}", f"`{record['command']}` · seed {record['seed']} · {versions} · data: {data}"]
        (folder / f'{self.name}.json').write_text(json.dumps(record, indent=1, default=_plain) + '\n', encoding='utf-8')
        page = folder / f'{self.name}.md'
        page.write_text('\n\n'.join(head + self._parts) + '\n', encoding='utf-8')
        return page


def _shown(cell):
    if isinstance(cell, (float, np.floating)):
        return f'{cell:.4g}'
    return str(cell)


def _plain(value):
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f'{type(value).__name__} cannot stand in a report')
