# The flight program: docker build -t corner-companion . How to run it, and without a registry: docs/install.md
FROM debian:trixie-slim
RUN apt-get update \
    && apt-get install --yes --no-install-recommends ca-certificates python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY pyproject.toml README.md LICENSE constraints.txt ./
COPY companion companion
COPY models models
COPY replay replay
RUN python3 -m venv /opt/corner \
    && /opt/corner/bin/pip install --no-cache-dir -c constraints.txt . \
    && useradd --create-home --uid 1000 --groups dialout corner
USER 1000
WORKDIR /data
ENV OMP_NUM_THREADS=1 PATH=/opt/corner/bin:$PATH
STOPSIGNAL SIGINT
ENTRYPOINT ["companion"]
