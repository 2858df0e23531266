"""Ships of the literature whose manoeuvring is public: particulars, figures with their source, mathematical models."""
