"""Reading the YAML files that list joints: joint maps and robots have the same head."""
from style_core.errors import ModelError
from style_core.yaml_file import read_yaml

__all__ = ['read_joint_file']


def read_joint_file(path, what, others=()):
    """Read a YAML file that holds ``joints``, may hold ``unlisted`` (``keep`` or ``drop``), and ``others``.

    Parameters
    ----------
    path : path-like
    what : str
        What the file is, for messages.
    others : sequence of str
        Further entries it may have.

    Returns
    -------
    joints : dict
        Name (str) -> entry, unchecked; empty where there are none.
    keep_unlisted : bool
    content : dict
        The whole file.

    Raises
    ------
    ModelError
        If the file cannot be read or does not have this form.
    """
    content = read_yaml(path, what)
    optional = ('unlisted', *others)
    if not isinstance(content, dict) or not set(content) <= {'joints', *optional}:
        raise ModelError(f'{what} {path} must hold "joints", may hold {", ".join(optional)}, and nothing else')
    joints, unlisted = content.get('joints') or {}, content.get('unlisted', 'drop')
    if not isinstance(joints, dict):
        raise ModelError(f'{path}: "joints" must map joints to what is said of them')
    if unlisted not in ('keep', 'drop'):
        raise ModelError(f'{path}: "unlisted" must be keep or drop, not {unlisted!r}')
    return {str(name): entry for name, entry in joints.items()}, unlisted == 'keep', content
