#pragma once

#include <string>

namespace tessera::render {

/// Returns whether the calling thread uses IEEE 754 defaults: round to nearest, denormals neither
/// flushed (FTZ) nor read as zero (DAZ). If so, remembers for describe_float_fault() which shared
/// libraries are loaded. Costs about 0.1 microseconds.
bool has_ieee_floats();

/// Returns a description of the calling thread's wrong mode, after has_ieee_floats() has returned
/// false, with the shared libraries loaded since the thread's last successful check. One of them
/// has probably changed the mode; the process cannot find out which instruction did.
std::string describe_float_fault();

/// Aborts the process with that description and `place` ("at the start of a unit") if
/// !has_ieee_floats(): a wrong mode would silently change pixels.
void require_ieee_floats(const char* place);

}  // namespace tessera::render
