# fieldtrace_component([MAY_INCLUDE FOLDER...] [LIBRARIES LIB...] [VECTOR_KERNELS FILE...])
#
# Adds the sources of the calling folder LIBRARY/COMPONENT to fieldtrace_LIBRARY. MAY_INCLUDE lists the folders whose
# headers they may include; include_direction_test parses and enforces it. LIBRARIES are linked privately.
# VECTOR_KERNELS are the files that Highway compiles once per instruction set (CompileOptions.cmake).
function(fieldtrace_component)
  cmake_parse_arguments(ARG "" "" "MAY_INCLUDE;LIBRARIES;VECTOR_KERNELS" ${ARGN})
  if(ARG_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "fieldtrace_component: unknown: ${ARG_UNPARSED_ARGUMENTS}")
  endif()
  cmake_path(GET CMAKE_CURRENT_SOURCE_DIR PARENT_PATH _parent)
  cmake_path(GET _parent FILENAME _library)
  file(GLOB _sources CONFIGURE_DEPENDS *.cpp)
  target_sources(fieldtrace_${_library} PRIVATE ${_sources})
  target_link_libraries(fieldtrace_${_library} PRIVATE ${ARG_LIBRARIES})
  foreach(_file ${ARG_VECTOR_KERNELS})
    fieldtrace_vector_kernels(${_file} fieldtrace_${_library})
  endforeach()
endfunction()
