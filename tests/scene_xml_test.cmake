fieldtrace_test(scene_xml_test LABELS quick)
fieldtrace_test(scene_environment_test LABELS quick)
fieldtrace_test(scene_errors_test LABELS quick)
fieldtrace_test(scene_recentre_test LABELS quick numerics)
