"""Declare a `ParameterTable` on a node and keep its values checked."""
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult

from style_core.errors import UsageError
from style_core.text import shown

__all__ = ['declare', 'values_of', 'watch']


def declare(node, table):
    """Declare every parameter with its description and range.

    Raises
    ------
    UsageError
        If the values given at the start are wrong, alone or together.
    """
    for one in table:
        descriptor = ParameterDescriptor(description=one.text)
        if isinstance(one.default, tuple):
            descriptor.dynamic_typing = True  # an empty list has no type of its own; the table checks it
        elif one.lower is not None and isinstance(one.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(one.lower), to_value=float(one.upper))]
        elif one.lower is not None:
            descriptor.integer_range = [IntegerRange(from_value=one.lower, to_value=one.upper, step=1)]
        default = list(one.default) if isinstance(one.default, tuple) else one.default
        try:
            node.declare_parameter(one.name, default, descriptor)
        except Exception as error:  # rclpy has a dozen kinds, all saying that the given value does not fit
            raise UsageError(f'parameter {one.name}: {error}') from None
    table.check(values_of(node, table))


def values_of(node, table):
    """All values of a table, as they stand now."""
    return {one.name: _plain(node.get_parameter(one.name).value, one.default) for one in table}


def watch(node, table, configured, apply):
    """Check every change against the whole table; refuse it as a whole with the reason, or apply it.

    Parameters
    ----------
    node : rclpy.node.Node
    table : ParameterTable
    configured : callable
        Tells whether parameters that are not live are fixed now.
    apply : callable
        Takes the complete new values; called only where something in the table changes.
    """
    defaults = {one.name: one.default for one in table}

    def on_set(parameters):
        changes = {one.name: _plain(one.value, defaults[one.name]) for one in parameters if one.name in defaults}
        if changes:
            try:
                apply(table.check_change(values_of(node, table), changes, configured()))
            except UsageError as error:
                return SetParametersResult(successful=False, reason=str(error))
            except Exception as error:  # the node stays, with the values it has
                if hasattr(node.executor, 'failures'):
                    node.executor.failures.note(error, node.get_logger())
                return SetParametersResult(successful=False, reason=shown(f'{type(error).__name__}: {error}', 400))
        return SetParametersResult(successful=True)
    node.add_on_set_parameters_callback(on_set)


def _plain(value, default=None):
    if value is None and isinstance(default, tuple):
        return []   # an empty list in a file or on a command line has no type
    return list(value) if isinstance(value, tuple) else value
