# What the store makes durable a second; run by hand with a folder on a real disk.
add_executable(store_bench EXCLUDE_FROM_ALL store/store_bench.cpp)
target_link_libraries(store_bench PRIVATE tessera::store zstd::libzstd_shared)
