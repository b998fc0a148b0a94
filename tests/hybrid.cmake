fieldtrace_test(hybrid_test LABELS quick)
target_sources(hybrid_test PRIVATE hybrid_scenes.cpp)
