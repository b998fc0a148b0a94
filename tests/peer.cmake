# Comparison with Mitsuba 3, where a Python with its package is at hand; skipped (and counted as such) otherwise.
find_package(Python3 QUIET COMPONENTS Interpreter)
set(FIELDTRACE_PEER_PYTHON "${Python3_EXECUTABLE}" CACHE FILEPATH "Python interpreter that has the package mitsuba")
if(FIELDTRACE_PEER_PYTHON AND TARGET fieldtrace)
  file(GLOB _peer_scenes CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/scenes/*.xml)
  # These need files that are made beforehand; what tools/make_reflections.sh makes, the comparison has made.
  list(FILTER _peer_scenes EXCLUDE REGEX "/(demo|crowd|stress|three_objects)\\.xml$")
  add_test(NAME peer.mitsuba
    COMMAND ${FIELDTRACE_PEER_PYTHON} ${CMAKE_CURRENT_SOURCE_DIR}/peer/mitsuba_peer.py
      --program $<TARGET_FILE:fieldtrace> --output ${CMAKE_BINARY_DIR}/peer ${_peer_scenes})
  set_tests_properties(peer.mitsuba PROPERTIES LABELS "slow;image" SKIP_RETURN_CODE 77 TIMEOUT 900)
endif()
