fieldtrace_test(command_line_test LABELS quick LIBRARIES fieldtrace_tools)
target_compile_definitions(command_line_test PRIVATE FIELDTRACE_PROGRAM="$<TARGET_FILE:fieldtrace>")
add_dependencies(command_line_test fieldtrace)
