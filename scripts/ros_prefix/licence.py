"""The licence of the wheel that ROS 2 is taken from: said before it is downloaded, asked once at a terminal."""
import os
import sys

from ros_prefix.downloads import REQUIREMENTS, SetupError, cache_folder, say, sha256, write

NOTICE = """\
This machine has no ROS 2 Humble, so a prefix is built from packages on PyPI and Debian headers. READ THIS FIRST:

  The largest package, isaacsim-ros2 (133 MB), is published by NVIDIA under the NVIDIA Omniverse License Agreement. In
  our words, with its clauses (its text is then in LICENSE-of-the-wheel.txt of the prefix; only that text counts):
    - whoever uses it has agreed to it, for a company with the authority to bind it;
    - not with any system whose use or failure can be expected to injure somebody (6.10). So NOT on an exosuit that a
      person wears, nor on a robot that moves near people: take another way there;
    - no distribution and no modification (6.4), no hosted or managed service for others (6.5), no competing products
      (6.14); three or more people of one organisation who work together need subscriptions (2.3, 6.2).
  The ROS 2 packages in it are open source under their own licences (Apache-2.0, BSD, ...), only those are unpacked, and
  the agreement gives a component's own licence precedence where the two conflict. What that means for you is for you,
  or your lawyer, to judge.

  Other ways, as good or better, without that agreement: Ubuntu 22.04 with apt, Docker, RoboStack (pixi, conda). See
  docs/setup.md."""


def terminal():
    """Is there somebody to ask: a terminal in and out, and this is not a job in its background?"""
    try:
        return (sys.stdin.isatty() and sys.stdout.isatty()
                and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp())
    except (OSError, ValueError, AttributeError):
        return False


def accept():
    """Say what the agreement means and have it accepted.

    ``STYLE_ACCEPT_LICENSE`` answers (1 or 0). Otherwise a terminal is asked, once for each version of the wheel; where
    there is none the set-up goes on, so that it runs unattended.

    Raises
    ------
    SetupError
        Where the answer is no.
    """
    remembered = cache_folder() / f'licence-accepted-{sha256(REQUIREMENTS / "ros_tree.txt")[:12]}'
    answer = os.environ.get('STYLE_ACCEPT_LICENSE', '').strip().lower()
    if remembered.exists() and not answer:
        return
    say(NOTICE)
    if not answer and not terminal():
        say('  There is no terminal to ask at, so this goes on (STYLE_ACCEPT_LICENSE=0 would stop here).\n')
        return
    if not answer:
        try:
            answer = input('Enter goes on and accepts it, n stops (STYLE_ACCEPT_LICENSE=1 answers this): ')
            answer = answer.strip().lower()
        except (EOFError, KeyboardInterrupt):
            answer = 'n'
    if answer not in ('', '1', 'y', 'yes', 'true'):
        raise SetupError('the licence was not accepted; nothing was downloaded. Other ways: docs/setup.md')
    write(remembered, b'accepted\n')
