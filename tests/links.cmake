# Links in the documents, and documents that comments name, lead somewhere.
find_package(Python3 QUIET COMPONENTS Interpreter)
if(Python3_EXECUTABLE)
  add_test(NAME links COMMAND ${Python3_EXECUTABLE} ${CMAKE_CURRENT_SOURCE_DIR}/links_test.py)
  set_tests_properties(links PROPERTIES LABELS quick TIMEOUT 60)
endif()
