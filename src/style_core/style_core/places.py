"""Where a file is that is called by its name: where the shell stands, or among those that come with the suite."""
import os
from pathlib import Path

from style_core.errors import ModelError
from style_core.text import did_you_mean, shown

__all__ = ['find_file', 'shipped_folder']

#: what comes with the suite -> its folder in config
_FOLDERS = {'model': 'models', 'joint map': 'joint_maps', 'robot': 'robots', 'chain': 'servo'}


def find_file(name, what, folder=''):
    """The file that a command or a parameter names.

    An absolute path is taken as it is. Any other is looked for in the working folder, then among the files of its kind
    that come with the suite.

    Parameters
    ----------
    name : str or path-like
    what : {'model', 'joint map', 'robot', 'chain'}
    folder : str or path-like, optional
        The only place to look in, instead of those two.

    Returns
    -------
    str
        ``name`` itself where it names something as it stands.

    Raises
    ------
    ModelError
        Where there is no such file; the message names both places.
    """
    name = os.fspath(name)
    shipped = None if folder else shipped_folder(what)
    for path in [os.path.join(folder, name)] if folder else [name, *([shipped / name] if shipped else [])]:
        if _is_there(path):
            return os.fspath(path)
    if os.path.isabs(name) or folder:
        raise ModelError(f'the {what} {os.path.join(folder, name)} does not exist')
    if shipped is None:
        raise ModelError(f'the {what} {name} does not exist in {Path.cwd()}, and no {what}s that come with the suite '
                         'are installed (no checkout, no sourced workspace)')
    there = sorted(path.name for path in shipped.iterdir() if path.suffix in ('.npz', '.yaml'))
    raise ModelError(f'the {what} {name} does not exist, neither in {Path.cwd()} nor in {shipped}'
                     + (did_you_mean(name, there) or f' (there: {", ".join(map(shown, there[:12]))})'))


def shipped_folder(what):
    """Folder of the models, maps, robots or chains that come with the suite, or None where none are installed.

    That of a sourced workspace, or the one that the checkout or the installation of this package holds.
    """
    shares = [Path(prefix, 'share', 'style_bringup') for prefix in
              filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))]
    above = Path(__file__).resolve().parents
    for share in [*shares, *above, *(folder / 'share' / 'style_bringup' for folder in above)]:
        folder = share / 'config' / _FOLDERS[what]
        if folder.is_dir():
            return folder
    return None


def _is_there(path):
    """Is there anything by this name? What cannot be looked at counts, so that the reader says why."""
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    except (OSError, ValueError):
        return True
    return True
