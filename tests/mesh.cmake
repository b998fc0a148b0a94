fieldtrace_test(mesh_test LABELS quick)
fieldtrace_test(mesh_io_test LABELS quick)
