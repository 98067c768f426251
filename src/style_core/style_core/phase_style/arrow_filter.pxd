"""The full filter (see arrow_filter.pyx)."""
from style_core.phase_style.arrow_forecast cimport ArrowForecast


cdef class ArrowFilter(ArrowForecast):
    cdef int _predict_common(self, double dt) noexcept nogil
    cdef int _condition(self) noexcept nogil
    cdef void _predict_parts(self, double dt) noexcept nogil
    cdef void _weigh(self, double phase) noexcept nogil
    cdef int _correct(self, const unsigned char[::1] observed, double dt) noexcept nogil
    cdef int _solve(self, double* squares) noexcept nogil
