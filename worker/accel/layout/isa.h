#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace tessera::render {

/// Instruction sets for which the traversal is compiled. AVX2 with FMA is the baseline.
enum class Isa : std::uint8_t { avx2, avx512 };

/// Returns whether this processor supports `isa`.
bool is_supported(Isa isa);

/// Returns the widest instruction set that this processor supports.
Isa best_isa();

/// Returns "avx2" or "avx512".
std::string_view isa_name(Isa isa);
/// Inverts isa_name(); returns nullopt for other names.
std::optional<Isa> parse_isa(std::string_view name);

}  // namespace tessera::render
