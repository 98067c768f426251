"""Play every situation, or those whose function's name holds one of the words given, and print a table."""
import re
import sys
import time
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from situations import files, machines, packages, stage, workspace

assert files and machines and packages and workspace  # importing them has registered their situations


def main(words):
    """Exit status 1 where a situation failed."""
    rows, failed, wanted = [], 0, [word for word in words if not word.startswith('-')]
    for text, function in stage.SITUATIONS:
        if wanted and not any(word in function.__name__ for word in wanted):
            continue
        started = time.monotonic()
        print(f'== {text} ({function.__name__})', flush=True)
        try:
            result = function()
        except stage.Skipped as reason:
            result = f'not played: {reason}'
        except Exception:
            traceback.print_exc()
            result, failed = 'FAILED (see above)', failed + 1
        seconds = time.monotonic() - started
        print(f'   {result} [{seconds:.0f} s]', flush=True)
        rows.append((text, f'`{function.__name__}`', re.sub(r'/tmp/style-setup-\w+', '...', result).replace('|', '/'),
                     f'{seconds:.0f}'))
    print('\n| situation | function | result | seconds |\n| --- | --- | --- | --- |')
    for row in rows:
        print('| ' + ' | '.join(row) + ' |')
    print(f'\n{len(rows) - failed} passed, {failed} failed')
    return failed > 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
