#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace tessera::render {

/// Instruction sets the traversal is compiled for. AVX2 with FMA is the baseline.
enum class Isa : std::uint8_t { avx2, avx512 };

/// Whether this processor has it.
bool is_supported(Isa isa);

/// The widest this processor has.
Isa best_isa();

/// "avx2" or "avx512".
std::string_view isa_name(Isa isa);
/// None for another name.
std::optional<Isa> parse_isa(std::string_view name);

}  // namespace tessera::render
