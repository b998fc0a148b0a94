# The benchmark command at a tiny size: that it runs, and the shape of what it writes. Needs the benchmark programs.
find_package(Python3 QUIET COMPONENTS Interpreter)
if(FIELDTRACE_BENCHMARKS AND Python3_EXECUTABLE)
  add_test(NAME measure.quick
    COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_SOURCE_DIR}/measure_test.py --program $<TARGET_FILE:fieldtrace>)
  set_tests_properties(measure.quick PROPERTIES LABELS quick TIMEOUT 300)
endif()
