/* Compile STYLE_BODY for any processor and, where the compiler can choose at run time, for AVX2. */
#define NAME(x) x##_plain
#include STYLE_BODY
#undef NAME
#ifdef STYLE_AVX2
#pragma GCC push_options
#pragma GCC target("avx2")
#define NAME(x) x##_avx2
#include STYLE_BODY
#undef NAME
#pragma GCC pop_options
#endif
#undef STYLE_BODY
