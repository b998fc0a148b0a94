fieldtrace_test(culling_bounds_test LABELS quick)
fieldtrace_test(bake_failure_test LABELS quick)
fieldtrace_test(cones_test LABELS quick)
fieldtrace_test(leaves_test LABELS quick)
