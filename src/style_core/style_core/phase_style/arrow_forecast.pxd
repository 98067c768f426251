"""Forecasts of the full filter (see arrow_forecast.pyx)."""
from style_core.phase_style.arrow cimport horizon
from style_core.phase_style.arrow_state cimport ArrowState


cdef class ArrowForecast(ArrowState):
    cdef int _expect(self, double late, double* mean, double* std) except -1
    cdef int _plan(self, const double[::1] horizons) except -1
    cdef long _plan_size(self) noexcept nogil
    cdef void _plan_one(self, double t, double* plan) noexcept nogil
    cdef void _ahead(self, const double* plan, horizon* x) noexcept nogil
    cdef void _enter(self, double phase, const double* left, horizon* x) noexcept nogil
    cdef void _forecast(self, const double[::1] horizons, double* mean, double* std, double* velocity) noexcept nogil
