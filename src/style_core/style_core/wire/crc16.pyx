"""The checksum of servo buses."""

cdef unsigned short TABLE[256]


cdef void fill() noexcept:
    cdef unsigned int byte, k, crc
    for byte in range(256):
        crc = byte << 8
        for k in range(8):
            crc = (crc << 1) ^ (0x8005 if crc & 0x8000 else 0)
        TABLE[byte] = <unsigned short>crc


fill()


def crc16(const unsigned char[::1] data, unsigned int crc=0):
    """CRC-16 with polynomial 0x8005 and no reflection, of the bytes that follow those whose CRC is ``crc``."""
    cdef Py_ssize_t i
    for i in range(data.shape[0]):
        crc = (crc << 8 & 0xFFFF) ^ TABLE[(crc >> 8 ^ data[i]) & 0xFF]
    return crc
