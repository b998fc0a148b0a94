fieldtrace_test(field_file_test LABELS quick)
fieldtrace_test(field_cache_test LABELS quick)
fieldtrace_test(bake_scene_test LABELS quick)
