#pragma once

namespace tessera::contract {

/// Version of the protocol that this program speaks. WorkerHello and CreateJobRequest carry it.
///
/// It is raised when a program that only ignores unknown fields and messages would misunderstand
/// the other side. New fields, messages and rpcs that may be ignored do not raise it. Programs
/// before 1.0 sent no version, which reads as 0.
inline constexpr int kProtocolVersion = 1;

/// Oldest version that a server of this program understands.
inline constexpr int kOldestProtocolVersion = 1;

}  // namespace tessera::contract
