"""How much is taken from outside: of every text, name, list, message, file and goal, in one place.

What is larger is refused with a reason before it is worked on; ``docs/budgets.md`` says what happens then.
"""

__all__ = ['TABLE', 'markdown']

#: of a style expression, in characters, and how deep its brackets may be nested
STYLE_TEXT, STYLE_DEPTH = 4096, 32
#: of a joint name or pattern, in bytes, and of all patterns of one list together; patterns in a list
NAME_BYTES, PATTERN_LIST_BYTES, PATTERNS = 256, 32_768, 512
#: of a path, in bytes
PATH_BYTES = 4096
#: of an error message, in characters; of one name quoted in a log line or a report
ERROR_TEXT, SHOWN_TEXT = 1000, 64
#: of one value, and of all values of one status, on /diagnostics, in characters
FACT_TEXT, FACTS_TEXT = 2048, 32_768
#: of names that no model knows and that are remembered to be reported: how many, and their bytes
UNKNOWN_NAMES, UNKNOWN_BYTES = 64, 4096
#: of lists of joint names that are remembered so that they need not be read again, in bytes
REMEMBERED_BYTES = 1 << 20
#: of a serialised joint state, estimate, style or sequence, in bytes
MESSAGE_BYTES = 1 << 20
#: joints of a message
JOINTS = 4096
#: of a YAML file, in bytes; how deep it may be nested; nodes in it, those behind aliases counted as often as they occur
YAML_BYTES, YAML_DEPTH, YAML_NODES = 1 << 18, 32, 50_000
#: of a NumPy archive (models, recordings), in bytes, as it lies on disk and unpacked; arrays in it; of an array's head
ARCHIVE_BYTES, UNPACKED_BYTES, ARCHIVE_MEMBERS, ARRAY_HEADER_BYTES = 256 << 20, 512 << 20, 10_000, 10_000
#: of a text recording, skeleton or URDF, in bytes
RECORDING_BYTES = 512 << 20
#: of a goal, s; of a sequence, s, and numbers in its occupancies
GOAL_S, SEQUENCE_S, SEQUENCE_NUMBERS = 600.0, 3600.0, 8_000_000
#: largest phase or phase velocity of an estimate, rad and rad/s: beyond it the fraction of a turn is rounding
LARGEST_PHASE = 1e6
#: loads of models that were given up and have not ended yet
HANGING_LOADS = 4

#: what is bounded, by how much, and what happens beyond, for people
TABLE = (
    ('style expression', f'{STYLE_TEXT} characters, {STYLE_DEPTH} levels of brackets', 'refused; the style stays'),
    ('joint name or pattern', f'{NAME_BYTES} bytes; a list of {PATTERNS} patterns and {PATTERN_LIST_BYTES} bytes',
     'refused; nothing is masked'),
    ('path of a model', f'{PATH_BYTES} bytes', 'refused; the model stays'),
    ('joint state, estimate, style, sequence', f'{MESSAGE_BYTES} bytes, {JOINTS} joints',
     'not read, counted as unreadable or refused'),
    ('names that the model does not know', f'{UNKNOWN_NAMES} names, {UNKNOWN_BYTES} bytes',
     'ignored like the others, but not remembered or reported'),
    ('remembered lists of names', f'{REMEMBERED_BYTES} bytes', 'forgotten and read anew'),
    ('error message, quoted name', f'{ERROR_TEXT} and {SHOWN_TEXT} characters',
     'cut; control characters are escaped'),
    ('value and status on /diagnostics', f'{FACT_TEXT} and {FACTS_TEXT} characters', 'cut, or left out'),
    ('joint map, robot, chain, plan (YAML)', f'{YAML_BYTES} bytes, {YAML_DEPTH} levels, {YAML_NODES} entries with '
     'those that aliases repeat', 'refused; the node is not configured'),
    ('model or recording (NPZ)', f'{ARCHIVE_BYTES >> 20} MiB on disk, {UNPACKED_BYTES >> 20} MiB unpacked, '
     f'{ARCHIVE_MEMBERS} arrays, regular files only', 'refused; the model in use stays'),
    ('recording or skeleton (text)', f'{RECORDING_BYTES >> 20} MiB, regular files only', 'refused'),
    ('sequence', f'{SEQUENCE_S:g} s, {SEQUENCE_NUMBERS} numbers', 'refused; what is performed goes on'),
    ('goal of the action', f'{GOAL_S:g} s', 'aborted with the reason'),
    ('phase and phase velocity of an estimate', f'{LARGEST_PHASE:g} rad, rad/s', 'refused and counted'),
    ('loads of models that hang', f'{HANGING_LOADS}', 'further ones are refused until one ends'),
)


def markdown():
    """Table for the documentation."""
    return '\n'.join(['| what | at most | beyond it |', '| --- | --- | --- |',
                      *(f'| {what} | {most} | {beyond} |' for what, most, beyond in TABLE)])
