# Fast CDR as the prefix carries it: one shared library and its headers.
get_filename_component(_fastcdr_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
set(fastcdr_VERSION 1.0.29)
if(NOT TARGET fastcdr)
  add_library(fastcdr SHARED IMPORTED)
  set_target_properties(fastcdr PROPERTIES
    IMPORTED_LOCATION "${_fastcdr_prefix}/lib/libfastcdr.so.1"
    IMPORTED_SONAME "libfastcdr.so.1"
    INTERFACE_INCLUDE_DIRECTORIES "${_fastcdr_prefix}/include")
endif()
unset(_fastcdr_prefix)
