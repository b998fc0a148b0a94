fieldtrace_test(sampling_test LABELS quick)
fieldtrace_test(lights_test LABELS quick)
fieldtrace_test(light_density_test LABELS quick)
fieldtrace_test(point_sets_test LABELS quick)
