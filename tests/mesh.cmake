fieldtrace_test(mesh_test LABELS quick)
