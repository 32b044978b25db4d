#pragma once

#include <string>

namespace tessera::render {

/// Returns whether the calling thread uses IEEE 754 defaults: round to nearest, denormals neither
/// flushed (FTZ) nor read as zero (DAZ). If so, remembers for describe_float_fault() which shared
/// libraries are loaded. Costs about 0.1 microseconds.
bool has_ieee_floats();

/// Says, after has_ieee_floats() has returned false, what is wrong with the calling thread and
/// which shared libraries were loaded since its last check that succeeded. One of them has probably
/// changed the mode: a process cannot know which instruction wrote the register.
std::string describe_float_fault();

/// Aborts the process with that description and `place` ("at the start of a unit") if
/// !has_ieee_floats(): a wrong mode would silently change pixels.
void require_ieee_floats(const char* place);

}  // namespace tessera::render
