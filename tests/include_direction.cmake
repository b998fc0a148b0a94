fieldtrace_test(include_direction_test LABELS quick)
# With sanitizers GCC 12 takes parts of std::regex for uninitialised.
if(FIELDTRACE_SANITIZE)
  set_source_files_properties(include_direction_test.cpp PROPERTIES COMPILE_OPTIONS -Wno-maybe-uninitialized)
endif()
