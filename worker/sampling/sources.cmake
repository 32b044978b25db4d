# Sources and headers of worker/sampling: target_sources(tessera_render PRIVATE … PUBLIC FILE_SET HEADERS …).
