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

# fieldtrace_module(NAME [COMPONENT NAME] [MAY_INCLUDE FOLDER...] [LIBRARIES LIB...])
#
# Makes the sources of the calling folder LIBRARY/COMPONENT libfieldtrace_NAME.so, which programs open when they first
# need it (core/platform/module.h). It uses headers of MAY_INCLUDE alone; libraries that bring many others belong here.
function(fieldtrace_module name)
  cmake_parse_arguments(ARG "" "COMPONENT" "MAY_INCLUDE;LIBRARIES" ${ARGN})
  if(ARG_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "fieldtrace_module: unknown: ${ARG_UNPARSED_ARGUMENTS}")
  endif()
  cmake_path(GET CMAKE_CURRENT_SOURCE_DIR PARENT_PATH _parent)
  cmake_path(GET _parent FILENAME _library)
  file(GLOB _sources CONFIGURE_DEPENDS *.cpp)
  add_library(fieldtrace_${name} MODULE ${_sources})
  target_link_libraries(fieldtrace_${name} PRIVATE fieldtrace_options ${ARG_LIBRARIES})
  set_target_properties(fieldtrace_${name} PROPERTIES
    LIBRARY_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/${FIELDTRACE_MODULE_DIR})
  # What links the library finds the module built.
  add_dependencies(fieldtrace_${_library} fieldtrace_${name})
  if(NOT ARG_COMPONENT)
    set(ARG_COMPONENT Unspecified)
  endif()
  install(TARGETS fieldtrace_${name} LIBRARY DESTINATION ${FIELDTRACE_MODULE_DIR} COMPONENT ${ARG_COMPONENT})
endfunction()
