"""Checked readers of serialised messages, made from what a message type says of itself."""
from importlib import import_module

from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    AbstractWString,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from style_core.wire.message_reader import Field, MessageReader

__all__ = ['reader_of']

_CODES = {'double': 'f8', 'float': 'f4', 'boolean': 'b1', 'octet': 'u1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1',
          'int16': 'i2', 'uint16': 'u2', 'int32': 'i4', 'uint32': 'u4', 'int64': 'i8', 'uint64': 'u8'}


def reader_of(message_type, what, wanted=None):
    """A `MessageReader` of a ROS message type; see there for ``what`` and ``wanted``.

    Raises
    ------
    TypeError
        Where the type has a field that no reader is made for (wide texts, long doubles).
    """
    return MessageReader(_fields(message_type), what, wanted)


def _fields(message_type):
    names = message_type.get_fields_and_field_types()
    return tuple(_field(name, slot) for name, slot in zip(names, message_type.SLOT_TYPES))


def _field(name, slot):
    length = most = 0
    if isinstance(slot, AbstractNestedType):
        length = slot.size if isinstance(slot, Array) else -1
        most = slot.maximum_size if isinstance(slot, BoundedSequence) else 0
        slot = slot.value_type
    if isinstance(slot, BasicType) and slot.typename in _CODES:
        return Field(name, _CODES[slot.typename], length, most)
    if isinstance(slot, AbstractString) and not isinstance(slot, AbstractWString):
        return Field(name, 'text', length, most, getattr(slot, 'maximum_size', 0))
    if isinstance(slot, NamespacedType):
        return Field(name, _fields(getattr(import_module('.'.join(slot.namespaces)), slot.name)), length, most)
    raise TypeError(f'no reader for {name}, {slot}')
