# The flight program: docker build -t corner-companion . How to run it: docs/install.md
FROM python:3.12-slim
WORKDIR /src
COPY pyproject.toml README.md LICENSE constraints.txt ./
COPY companion companion
COPY models models
COPY replay replay
RUN pip install --no-cache-dir -c constraints.txt . && useradd --create-home --uid 1000 --groups dialout corner
USER 1000
WORKDIR /data
ENV OMP_NUM_THREADS=1
STOPSIGNAL SIGINT
ENTRYPOINT ["companion"]
