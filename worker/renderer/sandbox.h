#pragma once

#include "absl/status/status.h"

namespace tessera::agent {

/// Installs a seccomp filter that denies this process for its lifetime what rendering does not
/// need: new sockets, executing programs, access to other processes, and opening files for writing.
/// A scene that exploits a parser can then reach neither the network nor the disk. Denied calls
/// fail with EPERM.
///
/// Reading files stays allowed, since libraries are loaded late, as does the use of open
/// descriptors. Call it while the process has one thread. Errors: Unavailable, the kernel does not
/// support seccomp filters; nothing is denied then.
absl::Status enter_sandbox();

}  // namespace tessera::agent
