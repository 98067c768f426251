#!/bin/bash
# Entry point of the container: the command runs in a shell that has sourced the workspace.
. /style-motion/install/setup.bash
exec "$@"
