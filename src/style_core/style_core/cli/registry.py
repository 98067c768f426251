"""Which module serves which command and which model kind. Modules are imported only when called.

A command module has a docstring (its ``--help`` text), ``add_arguments(parser, argv)`` and ``run(args)``.
A command that works on any model kind finds the kind in the model file and hands over to that kind's module.
"""

COMMANDS = {
}

#: ``motion-style train KIND``
TRAINERS = {
}
