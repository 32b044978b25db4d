#include "worker/accel/layout/isa.h"

namespace tessera::render {

bool is_supported(Isa isa) {
  if (isa == Isa::avx2) return true;
  return __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512bw") != 0 &&
         __builtin_cpu_supports("avx512dq") != 0 && __builtin_cpu_supports("avx512vl") != 0;
}

Isa best_isa() {
  return is_supported(Isa::avx512) ? Isa::avx512 : Isa::avx2;
}

std::string_view isa_name(Isa isa) {
  return isa == Isa::avx512 ? "avx512" : "avx2";
}

std::optional<Isa> parse_isa(std::string_view name) {
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (isa_name(isa) == name) return isa;
  }
  return std::nullopt;
}

}  // namespace tessera::render
